"""Parse the XML of robot files."""

from __future__ import annotations

from typing import Any

from kinseek.errors import InvalidRobot
from kinseek.support.forks import importing

XACRO = "http://www.ros.org/wiki/xacro"
"""Namespace of the commands of xacro."""


def root_element(text: bytes, where: str) -> Any:
    """Parse XML without comments, processing instructions, default namespaces and the namespace of its root.

    Readers of ROS know no namespaces: an element without a prefix means the same in each of them.

    Raises:
        InvalidRobot: The XML is broken, or uses an entity that is another file; the message contains the parser's own, with
            the line.
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
    own = etree.QName(root).namespace
    for element in root.xpath("descendant-or-self::*[namespace-uri()]"):
        name = etree.QName(element)
        if name.namespace == own or (element.prefix is None and name.namespace != XACRO):
            element.tag = name.localname
    return root
