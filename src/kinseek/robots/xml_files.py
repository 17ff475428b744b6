"""Parse the XML of robot files."""

from __future__ import annotations

import re
from typing import Any

from kinseek.errors import InvalidRobot
from kinseek.support.forks import importing

XACRO = "http://www.ros.org/wiki/xacro"
"""Namespace of the commands of xacro."""

ENCODINGS = re.compile(
    r"utf-?8|utf-?16(le|be)?|(us-)?ascii|iso[-_]?8859-\d+|latin-?\d+|(windows-|cp)125\d|koi8-[ru]|"
    r"gb2312|gbk|gb18030|big5|shift[-_]jis|euc-(jp|kr|tw|cn)",
    re.IGNORECASE,
)
"""Encodings in which markup is written in one way only, or that readers without encodings cannot read at all. In others,
such as UTF-7, a comment can end where neither these readers, those of ROS and MuJoCo, nor an editor see its end."""


def root_element(text: bytes, where: str) -> Any:
    """Parse XML without comments, processing instructions, default namespaces and the namespace of its root.

    Readers of ROS know no namespaces: an element without a prefix means the same in each of them.

    Raises:
        InvalidRobot: The XML is broken, or uses an entity that is another file; the message contains the parser's own, with
            the line. Or readers without document types, encodings or namespaces would read something else.
    """
    with importing:
        from lxml import etree

    # Not huge_tree, which would lift the parser's limits on depth and on entities made of entities.
    parser = etree.XMLParser(
        remove_comments=True, remove_pis=True, resolve_entities="internal", no_network=True
    )
    try:
        root = etree.fromstring(text, parser)
    except (etree.XMLSyntaxError, LookupError) as error:  # An unknown encoding raises LookupError.
        raise InvalidRobot(f"{where}: broken XML: {getattr(error, 'msg', None) or error}") from None
    document = root.getroottree().docinfo
    if document.internalDTD is not None:
        # For these readers it ends at the first >, and they ignore what it declares as an entity or a default.
        raise InvalidRobot(
            f"{where}: it has a document type (<!DOCTYPE …>), which MuJoCo and readers of ROS do not read; take it out, and "
            "write what its entities stand for"
        )
    encoding = document.encoding or "UTF-8"
    if ENCODINGS.fullmatch(encoding) is None:
        raise InvalidRobot(f"{where}: the encoding {encoding!r:.100} is not read; write the file in UTF-8")
    own = etree.QName(root).namespace
    for element in root.xpath("descendant-or-self::*[namespace-uri()]"):
        name = etree.QName(element)
        foreign = element.prefix not in (None, root.prefix)
        if foreign and name.namespace == own != XACRO:
            raise InvalidRobot(
                f"{where}: <{element.prefix}:{name.localname}> in line {element.sourceline} is of the namespace of the "
                "root, and readers of ROS know no namespaces; write it without a prefix, or take it out"
            )
        if (name.namespace == own and not foreign) or (element.prefix is None and name.namespace != XACRO):
            element.tag = name.localname
    return root


def text_of(root: Any) -> bytes:
    """Return the XML of a root element."""
    with importing:
        from lxml import etree

    return bytes(etree.tostring(root))
