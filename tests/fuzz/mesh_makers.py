"""Makes random mesh files of a few bodies, with every part of each format that concerns shapes, and mutates them."""

from __future__ import annotations

import copy
import json
import math
import struct
from collections.abc import Callable, Mapping
from random import Random
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

SPACE = "http://www.collada.org/2005/11/COLLADASchema"
L_SHAPE = ((0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2))
ODD_NUMBERS = """1.5.5 1-1 +-1 1e 0x1 1,2 inf nan 1_0 1d0 .5 5. -.5e1 --1 1e400 ٣ 1\u00a02 1\u20282 1\u00852 007 +1 1e-400 -0
-1 4294967297 2147483648 65535 255 1e308 3.0 1f 1e5 . e5 + 0.1E+2""".replace("\n", " ").split(" ")
ODD_BLANKS = (
    "\n",
    "\t",
    "\r",
    "\r\n",
    "  ",
    "\u00a0",
    "\u2028",
    "\u2003",
    "\u0085",
    "\v",
    "\f",
    "\0",
    ",",
    "\\\n",
    "",
)
ODD_ATTRIBUTES = [
    "",
    "0",
    "1",
    "2",
    "3",
    "4",
    "6",
    "9",
    "-1",
    "+1",
    "01",
    " 1",
    "1 ",
    "1.0",
    "x",
    "VERTEX",
    "POSITION",
    "NORMAL",
    "vertex",
    "X",
    "Y",
    "W",
    "#",
    "None",
    "#g0",
    "#n0",
    "#scene",
    "g0",
    "1e400",
]


class Shape:
    """Points, and polygons of them: all of one flat side, and all with a corner that sees the others."""

    def __init__(self, random: Random) -> None:
        """Draw it."""
        self.points: list[list[float]] = [
            [_coordinate(random) for _ in range(3)] for _ in range(random.randint(3, 5))
        ]
        self.polygons: list[list[int]] = [
            random.sample(range(len(self.points)), 3) for _ in range(random.randint(1, 3))
        ]
        for _ in range(random.choice((0, 0, 1, 2))):
            flat = L_SHAPE if random.random() < 0.3 else _convex(random)
            frame = np.array([[random.uniform(-2, 2) for _ in range(3)] for _ in range(3)])
            first = len(self.points)
            self.points += [
                [float(f"{each:.12g}") for each in frame[0] + x * frame[1] + y * frame[2]] for x, y in flat
            ]
            ring = list(range(first, len(self.points)))
            turn = random.randrange(len(ring))
            ring = ring[turn:] + ring[:turn]
            self.polygons.append(ring[::-1] if random.random() < 0.5 else ring)
        random.shuffle(self.polygons)


def _coordinate(random: Random) -> float:
    value = random.choice((float(random.randint(-5, 5)), random.uniform(-3, 3)))
    return float(f"{value * random.choice((1, 1, 1, 1, 1e-3, 100)):.12g}")


def _convex(random: Random) -> list[tuple[float, float]]:
    count = random.randint(3, 6)
    angles = sorted(2 * math.pi * (k + random.uniform(0, 0.6)) / count for k in range(count))
    return [(math.cos(each), math.sin(each)) for each in angles]


def word(random: Random, value: float) -> str:
    """A number as text."""
    forms = ("{!r}", "{!r}", "{:.13e}", "{:+.15g}", "{:.13E}")
    return random.choice(forms).format(value)


def words(random: Random, values: list[float]) -> str:
    return " ".join(word(random, each) for each in values)


class Collada:
    """Makes one file of COLLADA; an odd one has what kinseek refuses on purpose: sources with more than the coordinates."""

    def __init__(self, random: Random, odd: bool) -> None:
        self.random, self.odd, self.nodes = random, odd, list[str]()

    def source(self, name: str, rows: list[list[float]], names: str) -> str:
        random, width = self.random, len(names)
        before, after = (int(self.odd and random.random() < 0.1) for _ in range(2))
        data = [0.5] * before + [each for row in rows for each in [*row, *[0.25] * after]]
        params = (
            "".join(f'<param name="{each}" type="float"/>' for each in names)
            + '<param type="float"/>' * after
        )
        offset = f' offset="{before}"' if before else ""
        return (
            f'<source id="{name}"><float_array id="{name}a" count="{len(data)}">{words(random, data)}</float_array>'
            f'<technique_common><accessor source="#{name}a" count="{len(rows)}" stride="{width + after}"{offset}>{params}'
            "</accessor></technique_common></source>"
        )

    def surface(self, name: str, shape: Shape) -> str:
        random = self.random
        kind = random.choice(("triangles", "tristrips", "trifans", "polylist", "polygons"))
        inputs = [
            ("VERTEX", f"{name}v", ""),
            *(
                each
                for each in (
                    ("NORMAL", f"{name}s", ""),
                    ("TEXCOORD", f"{name}t", ' set="0"'),
                    ("COLOR", f"{name}s", ""),
                )
                if random.random() < 0.3
            ),
        ]
        random.shuffle(inputs)
        offsets = [random.randint(0, k) for k in range(len(inputs))]
        width, at = max(offsets) + 1, offsets[[each[0] for each in inputs].index("VERTEX")]
        told = "".join(
            f'<input semantic="{semantic}" source="#{source}" offset="{offset}"{end}/>'
            for (semantic, source, end), offset in zip(inputs, offsets, strict=True)
        )

        def p(corners: list[int]) -> str:
            some = [random.randrange(3) for _ in range(len(corners) * width)]
            some[at::width] = corners
            return f"<p>{' '.join(map(str, some))}</p>"

        if kind == "triangles":
            some = [each for each in shape.polygons if len(each) == 3]
            body = p([k for each in some for k in each])
        elif kind == "polylist":
            some = shape.polygons
            body = f"<vcount>{' '.join(str(len(each)) for each in some)}</vcount>{p([k for each in some for k in each])}"
        elif kind == "polygons":
            some = shape.polygons
            body = "".join(map(p, some))
        else:
            count = range(len(shape.points))
            some = [
                random.sample(count, random.randint(3, min(5, len(count))))
                for _ in range(random.randint(1, 2))
            ]
            body = "".join(map(p, some))
        material = random.choice(("", ' material="m"'))
        return f'<{kind} count="{len(some)}"{material}>{told}{body}</{kind}>'

    def geometry(self, name: str) -> str:
        random, shape = self.random, Shape(self.random)
        parts = "".join(self.surface(name, shape) for _ in range(random.randint(1, 2)))
        inputs = [f'<input semantic="POSITION" source="#{name}s"/>']
        if random.random() < 0.2:
            inputs.insert(random.randint(0, 1), f'<input semantic="NORMAL" source="#{name}s"/>')
        sources = self.source(f"{name}s", shape.points, "XYZ") + self.source(f"{name}t", [[0, 1]] * 3, "ST")
        vertices = f'<vertices id="{name}v">{"".join(inputs)}</vertices>'
        return f'<geometry id="{name}"><mesh>{sources}{vertices}{parts}</mesh></geometry>'

    def motions(self) -> str:
        random, found = self.random, ""
        for _ in range(random.choice((0, 1, 1, 2))):
            kind = random.choice(("translate", "scale", "rotate", "matrix"))
            axis = random.choice(("1 0 0", "0 1 0", "0 0 1", "0.6 0.8 0"))
            numbers = [_coordinate(random) or 1.0 for _ in range(12)]  # A scale of 0 leaves no orientation.
            found += {
                "rotate": f"<rotate>{axis} {word(random, numbers[0])}</rotate>",
                "matrix": f"<matrix>{words(random, numbers)} 0 0 0 1</matrix>",
            }.get(kind, f"<{kind}>{words(random, numbers[:3])}</{kind}>")
        return found

    def node(self, geometries: list[str], below: list[str], depth: int = 0) -> str:
        random, name = self.random, f"n{len(self.nodes)}"
        self.nodes.append(name)
        inner, parts = self.motions(), list[str]()
        bound = "<technique_common><instance_material symbol='m' target='#red'/></technique_common>"
        bound = f"<bind_material>{bound}</bind_material>"
        for each in random.choices(geometries, k=random.randint(0 if depth else 1, 2)):
            parts.append(f'<instance_geometry url="#{each}">{random.choice(("", bound))}</instance_geometry>')
        if below and random.random() < 0.4:
            parts.append(f'<instance_node url="#{random.choice(below)}"/>')
        if depth < 2 and random.random() < 0.4:
            parts.append(self.node(geometries, below, depth + 1))
        return f'<node id="{name}">{inner}{"".join(parts)}</node>'

    def text(self) -> str:
        random, geometries, library, tops = (
            self.random,
            ["g0", "g1"][: self.random.randint(1, 2)],
            "",
            list[str](),
        )
        for _ in range(random.choice((0, 0, 1, 2))):
            name = f"n{len(self.nodes)}"
            library += self.node(geometries, tops)
            tops.append(name)
        scene = "".join(self.node(geometries, tops) for _ in range(random.randint(1, 2)))
        parts = [
            f"<library_geometries>{''.join(map(self.geometry, geometries))}</library_geometries>",
            f"<library_nodes>{library}</library_nodes>" if library else "",
            f'<library_visual_scenes><visual_scene id="scene">{scene}</visual_scene></library_visual_scenes>',
            '<library_effects><effect id="e"><profile_COMMON><technique sid="t"><lambert><diffuse><color>1 0 0 1</color>'
            "</diffuse></lambert></technique></profile_COMMON></effect></library_effects>"
            '<library_materials><material id="red"><instance_effect url="#e"/></material></library_materials>',
        ]
        random.shuffle(parts)
        unit = random.choice(
            ("", '<unit meter="1"/>', '<unit meter="0.01"/>', '<unit name="inch" meter="2.54e-2"/>')
        )
        axis = random.choice(("", *(f"<up_axis>{each}_UP</up_axis>" for each in "XYZ")))
        return (
            f'<COLLADA xmlns="{SPACE}" version="1.4.1"><asset>{unit}{axis}</asset>{"".join(parts)}'
            '<scene><instance_visual_scene url="#scene"/></scene></COLLADA>'
        )


TAGS = [
    "node",
    "mesh",
    "geometry",
    "source",
    "vertices",
    "input",
    "p",
    "ph",
    "vcount",
    "translate",
    "rotate",
    "scale",
    "matrix",
    "lookat",
    "skew",
    "extra",
    "asset",
    "unit",
    "scene",
    "lines",
    "triangles",
    "polylist",
    "polygons",
    "tristrips",
    "trifans",
    "instance_geometry",
    "instance_node",
    "instance_controller",
    "accessor",
    "param",
    "float_array",
    "technique_common",
    "technique",
    "visual_scene",
    "library_nodes",
    "library_geometries",
    "convex_mesh",
    "linestrips",
    "Mesh",
]


def mutate_xml(random: Random, root: Any) -> None:
    """Change one thing of a tree."""
    elements = [each for each in root.iter() if isinstance(each.tag, str) and each is not root]
    element = random.choice(elements)
    parent = element.getparent()
    listed = [each for each in elements if (each.text or "").strip() and not len(each)] or [element]
    names = [each.get("id") for each in elements if each.get("id")] or ["none"]
    changes = "copy remove move rename space attribute attribute number number number semantic reference id split remark"
    match random.choice((changes + " cdata add swap wrap blank blank drop").split()):
        case "copy":
            twin = copy.deepcopy(element)
            for each in twin.iter() if random.random() < 0.5 else ():
                if isinstance(each.tag, str) and each.get("id"):
                    each.set("id", each.get("id") + "x")
            parent.insert(random.randint(0, len(parent)), twin)
        case "remove":
            parent.remove(element)
        case "move":
            other = random.choice(elements)
            if other is not element and element not in list(other.iterancestors()):
                other.insert(random.randint(0, len(other)), element)
        case "rename":
            element.tag = f"{{{SPACE}}}{random.choice(TAGS)}"
        case "space":
            space = random.choice(("{http://x}", "", "{http://www.collada.org/2008/03/COLLADASchema}"))
            for each in element.iter() if random.random() < 0.5 else (element,):
                if isinstance(each.tag, str):
                    each.tag = space + each.tag.rpartition("}")[2]
        case "attribute" if element.attrib:
            name = random.choice(list(element.attrib))
            value = element.get(name)
            same = (f" {value}", f"{value}\n", f"\u00a0{value}", value.upper(), f"#{value}", f"{value}x")
            element.set(name, random.choice((*ODD_ATTRIBUTES, *same)))
        case "drop" if element.attrib:
            del element.attrib[random.choice(list(element.attrib))]
        case "number":
            element = random.choice(listed)
            some = (element.text or "").split() or ["0"]
            at = random.randrange(len(some))
            some[at : at + 1] = [random.choice(("", "0 1", some[at] + " 0", "1 2 0", *ODD_NUMBERS))]
            element.text = " ".join(some)
        case "semantic":
            element = random.choice([each for each in elements if each.get("semantic")] or [element])
            element.set("semantic", random.choice(("VERTEX", "POSITION", "NORMAL", "TEXCOORD", "UV", "")))
        case "reference":
            element = random.choice(
                [each for each in elements if each.get("url") or each.get("source")] or [element]
            )
            element.set("url" if element.get("url") else "source", f"#{random.choice([*names, ''])}")
        case "id":
            random.choice([each for each in elements if each.get("id")] or [element]).set(
                "id", random.choice(names)
            )
        case "add":
            name = random.choice(
                ["id", "offset", "stride", "count", "url", "source", "sid", "name", "meter", "set", "xmlns2"]
            )
            element.set(name, random.choice((*ODD_ATTRIBUTES, *names)))
        case "split":
            element = random.choice([element, random.choice(listed)])
            twin, some = copy.deepcopy(element), (element.text or "").split()
            cut = random.randint(0, len(some))
            if not len(element):
                element.text, twin.text = " ".join(some[:cut]), " ".join(some[cut:])
            element.addnext(twin)
        case "remark":
            remark = random.choice(
                (etree.Comment("1 2"), etree.ProcessingInstruction("x", "1 2"), etree.Comment("<p>0</p>"))
            )
            element = random.choice([element, random.choice(listed)])
            text = element.text or ""
            at = random.randint(0, len(text))
            element.text, remark.tail = text[:at], text[at:]
            element.insert(0, remark)
        case "cdata":
            element = random.choice(listed)
            if not len(element):
                element.text = etree.CDATA(element.text or " ")
        case "swap":
            some = list(parent)
            random.shuffle(some)
            for each in some:
                parent.append(each)
        case "wrap":
            around = etree.Element(f"{{{SPACE}}}{random.choice(TAGS)}")
            parent.replace(element, around)
            around.append(element)
        case "blank":
            element = random.choice([element, random.choice(listed)])
            blank = random.choice(("\n", "\t", "\r", "  ", "\u00a0", "\u2003", "\u2028", "\u0085", ",", ""))
            if element.text and " " in element.text:
                element.text = element.text.replace(" ", blank, random.choice((1, -1)))
            else:
                element.text = blank + (element.text or "")


def dae(random: Random, mutations: int) -> bytes:
    """A file of COLLADA."""
    text: bytes = Collada(random, mutations > 0).text().encode()
    if mutations:
        root = etree.fromstring(text)
        for _ in range(mutations):
            try:
                mutate_xml(random, root)
            except ValueError:  # A name or a letter that lxml does not write.
                continue
        encoding = random.choice(("utf-8",) * 6 + ("utf-16", "iso-8859-1", "us-ascii"))
        text = etree.tostring(root, encoding=encoding, xml_declaration=random.random() < 0.5 or None)
        if random.random() < 0.1:
            text = mutate_bytes(random, text)
    return text


class Glb:
    """Makes one file of GLB."""

    def __init__(self, random: Random) -> None:
        self.random, self.bytes = random, bytearray()
        self.views, self.accessors = list[dict[str, Any]](), list[dict[str, Any]]()

    def view(self, data: bytes, **more: int) -> int:
        self.bytes += b"\xab" * (-len(self.bytes) % 4 + 4 * self.random.randint(0, 1))
        self.views.append({"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(data), **more})
        self.bytes += data
        return len(self.views) - 1

    def rows(self, points: NDArray[np.float32]) -> tuple[int, int]:
        """Accessors of positions and of normals, which may take turns in one view."""
        low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        common = {"componentType": 5126, "count": len(points), "type": "VEC3"}
        places, normals = common | {"min": low, "max": high}, common | {}
        match self.random.choice(("tight", "tight", "stride", "turns")):
            case "tight":
                before = 12 * self.random.randint(0, 1)
                places |= {"bufferView": self.view(b"\x11" * before + points.tobytes())}
                places |= {"byteOffset": before} if before else {}
                normals |= {"bufferView": self.view(points.tobytes())}
            case "stride":
                places |= {
                    "bufferView": self.view(
                        b"".join(each.tobytes() + b"\1\2\3\4" for each in points), byteStride=16
                    )
                }
                normals |= {"bufferView": self.view(points.tobytes())}
            case _:
                view = self.view(
                    b"".join((-each).tobytes() + each.tobytes() for each in points),
                    byteStride=24,
                )
                places |= {"bufferView": view, "byteOffset": 12}
                normals |= {"bufferView": view, "byteOffset": 0}
        self.accessors += [places, normals]
        return len(self.accessors) - 2, len(self.accessors) - 1

    def indices(self, corners: list[int]) -> int:
        kind, form = self.random.choice(((5121, "<u1"), (5123, "<u2"), (5125, "<u4")))
        data = np.array(corners, form)
        before = self.random.randint(0, 1)
        view = self.view(bytes(before * data.itemsize) + data.tobytes())
        found = {"bufferView": view, "componentType": kind, "count": len(corners), "type": "SCALAR"}
        self.accessors.append(found | ({"byteOffset": data.itemsize} if before else {}))
        return len(self.accessors) - 1

    def primitive(self) -> dict[str, Any]:
        random = self.random
        count = random.choice((3, 6))
        points = np.array([[_coordinate(random) for _ in range(3)] for _ in range(count)], "<f4")
        places, normals = self.rows(points)
        found: dict[str, Any] = {"attributes": {"POSITION": places}}
        if random.random() < 0.3:
            found["attributes"]["NORMAL"] = normals
        if mode := random.choice((None, 4, 5, 6)):
            found["mode"] = mode
        if random.random() < 0.6:
            many = random.choice((3, 6) if mode in (None, 4) else (3, 4, 5))
            found["indices"] = self.indices([random.randrange(count) for _ in range(many)])
        if random.random() < 0.2:
            found["material"] = 0
        return found

    def node(self, meshes: int) -> dict[str, Any]:
        random, found = self.random, dict[str, Any]()
        if random.random() < 0.8:
            found["mesh"] = random.randrange(meshes)
        if random.random() < 0.4:
            found["name"] = random.choice(("a", "world", "0", "1", "a_1", "", "b"))
        turn = np.array([random.gauss(0, 1) for _ in range(4)])
        x, y, z, w = turn = turn / np.linalg.norm(turn)
        move = [float(random.randint(-3, 3)) for _ in range(3)]
        scale = [random.choice((-1, 1)) * round(random.uniform(0.3, 2), 2) for _ in range(3)]
        if random.random() < 0.3:
            skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            matrix = np.eye(4)
            matrix[:3, :3] = (np.eye(3) + 2 * w * skew + 2 * skew @ skew) * scale
            matrix[:3, 3] = move
            return found | {"matrix": matrix.T.ravel().tolist()}
        for name, value in (("translation", move), ("rotation", turn.tolist()), ("scale", scale)):
            if random.random() < 0.5:
                found[name] = value
        return found

    def tree(self) -> dict[str, Any]:
        random = self.random
        meshes = [
            {"primitives": [self.primitive() for _ in range(random.randint(1, 2))]}
            for _ in range(random.randint(1, 2))
        ]
        nodes, roots = [self.node(len(meshes)) for _ in range(random.randint(1, 4))], list[int]()
        nodes[0]["mesh"] = 0
        for k in range(len(nodes)):
            if k and random.random() < 0.6:
                nodes[random.randrange(k)].setdefault("children", []).append(k)
            else:
                roots.append(k)
        found: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "buffers": [{"byteLength": len(self.bytes)}],
            "bufferViews": self.views,
            "accessors": self.accessors,
            "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}],
            "meshes": meshes,
            "nodes": nodes,
            "scenes": [{"nodes": roots}],
        }
        if random.random() < 0.5:
            found["scene"] = 0
        if random.random() < 0.2:
            others = {"nodes": [roots[0]]}
            found["scenes"].insert(random.randint(0, 1), others)
            found["scene"] = int(found["scenes"][0] is others and len(roots) > 1) or found["scenes"].index(
                others
            )
        return found


KEYS = [
    "matrix",
    "translation",
    "rotation",
    "scale",
    "mesh",
    "children",
    "skin",
    "camera",
    "mode",
    "indices",
    "attributes",
    "byteOffset",
    "byteStride",
    "count",
    "componentType",
    "type",
    "sparse",
    "normalized",
    "nodes",
    "scene",
    "name",
    "extras",
    "weights",
    "primitives",
    "POSITION",
    "extensions",
    "bufferView",
    "byteLength",
    "targets",
    "extensionsRequired",
    "extensionsUsed",
    "uri",
    "buffer",
]
VALUES: tuple[Any, ...] = (
    0,
    1,
    2,
    3,
    4,
    5,
    6,
    7,
    -1,
    True,
    False,
    None,
    1.0,
    1.5,
    "0",
    "1",
    [],
    [0],
    [1],
    [0, 0, 0],
    [1, 2, 3],
    [0, 0, 0, 1],
    {},
)
VALUES += (
    "POSITION",
    "VEC3",
    "VEC4",
    "SCALAR",
    "world",
    5120,
    5121,
    5122,
    5123,
    5124,
    5125,
    5126,
    12,
    16,
    36,
    252,
    1e-9,
    1e39,
)
VALUES += (
    [{}],
    {"EXT_mesh_gpu_instancing": {}},
    {"KHR_draco_mesh_compression": {}},
    ["KHR_mesh_quantization"],
    [-1, 1, 1],
    10**30,
)


def spots(tree: Any) -> list[tuple[Any, Any]]:
    """All places of a JSON tree: an object or a list, and a key or an index."""
    found = list[tuple[Any, Any]]()
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ():
        found += [(tree, key), *spots(tree[key])]
    return found


def mutate_json(random: Random, tree: Any) -> None:
    """Change one thing of a tree."""
    everywhere = spots(tree)
    place, key = random.choice(everywhere)
    match random.choice(
        ["remove", "set", "set", "set", "number", "number", "copy", "add", "add", "swap", "twin"]
    ):
        case "remove":
            del place[key]
        case "set":
            place[key] = copy.deepcopy(random.choice(VALUES))
        case "number":
            place, key = random.choice(
                [each for each in everywhere if type(each[0][each[1]]) in (int, float)] or [(place, key)]
            )
            if type(place[key]) in (int, float):
                place[key] += random.choice((1, -1, 0.5, 4, -4, 12, 1e-4))
        case "copy" if isinstance(place, list):
            place.insert(random.randint(0, len(place)), copy.deepcopy(place[key]))
        case "add":
            objects = [found for each in everywhere if isinstance(found := each[0][each[1]], dict)]
            random.choice([*objects, tree])[random.choice(KEYS)] = copy.deepcopy(random.choice(VALUES))
        case "swap" if isinstance(place, list):
            random.shuffle(place)
        case "twin":
            other, other_key = random.choice(everywhere)
            place[key] = copy.deepcopy(other[other_key])


def packed(random: Random, told: bytes, data: bytes, odd: bool) -> bytes:
    """A file from its JSON and its bytes."""
    told += b" " * (-len(told) % 4)
    data += bytes(-len(data) % 4)
    parts = [(b"JSON", told), (b"BIN\0", data)]
    if odd:
        match random.randrange(8):
            case 0:
                parts.append((random.choice((b"BIN\0", b"JSON", b"EXT\0")), random.choice((told, data, b""))))
            case 1:
                parts.reverse()
            case 2:
                parts.insert(1, (b"EXT\0", b"1234"))
            case 3:
                parts[0] = (
                    b"JSON",
                    random.choice((b"\xef\xbb\xbf", b" \n", b""))
                    + told
                    + random.choice((b"\0", b"x", b"\n")),
                )
            case 4:
                parts[1] = (b"BIN\0", data + bytes(8))
            case 5:
                parts[1] = (b"BIN\0", data[:-4])
            case 6:
                parts[0] = (b"JSON", told.replace(b": ", b":", 1) + b" ")
    body = b"".join(struct.pack("<I4s", len(data), kind) + data for kind, data in parts)
    length = 12 + len(body) + (random.choice((-4, -1, 0, 1, 4)) if odd else 0)
    return struct.pack("<4sII", b"glTF", random.choice((1, 2, 2, 3)) if odd else 2, length) + body


def glb(random: Random, mutations: int) -> bytes:
    """A file of GLB."""
    maker = Glb(random)
    tree, kinds = maker.tree(), [random.random() for _ in range(mutations)]
    for each in kinds:
        if each < 0.8 and tree:
            mutate_json(random, tree)
    told = json.dumps(tree)
    for each in kinds:
        if 0.8 <= each < 0.85:  # A name that an object has twice.
            name = random.choice(
                ("mesh", "count", "matrix", "byteOffset", "children", "version", "nodes", "translation")
            )
            told = told.replace(f'"{name}":', f'"{name}": 0, "{name}":', 1)
        elif 0.85 <= each < 0.9:
            old = random.choice((": 0", ": 1", ": 2", "0.5", "1.0"))
            told = told.replace(
                old, old[:-1] + random.choice(("01", "1e0", "NaN", "1E400", "-0", "Infinity", "1.0")), 1
            )
    text = packed(random, told.encode(), bytes(maker.bytes), any(0.9 <= each < 0.95 for each in kinds))
    return mutate_bytes(random, text) if any(each >= 0.95 for each in kinds) else text


def obj(random: Random, mutations: int) -> bytes:
    """A file of Wavefront."""
    lines, points = list[str](), 0
    if random.random() < 0.2:
        lines += ["mtllib none.mtl"]
    textures = random.randint(0, 2)
    lines += [f"vt {words(random, [0.5, 0.25])}"] * textures + ["vn 0 0 1"]
    for body in range(random.randint(1, 3)):
        shape = Shape(random)
        end = random.choice(("", "", " 1", " 1.0", " 0.5 0.5 0.5"))
        lines += random.choice(
            ([], [f"o b{body}"], ["g a b", "s off"], ["usemtl red"], ["# solid", ""], ["vp 0 0"][:0])
        )
        lines += [f"v {words(random, each)}{end}" for each in shape.points]
        for polygon in shape.polygons:
            first = -len(shape.points) if random.random() < 0.3 else points + 1
            forms = ["{}", "{}//1", "{}//-1", *(["{}/1", "{}/-1/1", "{}/1/1"] if textures else [])]
            form = random.choice(forms)
            lines.append("f " + " ".join(form.format(first + each) for each in polygon))
        if random.random() < 0.2:
            lines += random.choice((["l 1 2"], ["p 1"], ["usemtl blue"], ["s 1"]))
        points += len(shape.points)
    for k, line in enumerate(lines):
        if " " in line and line[0] in "vf" and random.random() < 0.05:
            lines[k] = line.replace(
                " ", random.choice((" \\\n", "\t", "  ", " \\\n ")), random.choice((1, 2))
            )
        elif random.random() < 0.05:
            lines[k] += random.choice((" # f 1 2 3", " ", "\t"))
    mutate_lines(random, lines, mutations)
    return finished(random, lines, mutations)


OBJ_NAMES = [
    "v",
    "vt",
    "vn",
    "vp",
    "f",
    "fo",
    "l",
    "p",
    "g",
    "o",
    "s",
    "mtllib",
    "usemtl",
    "call",
    "csh",
    "surf",
    "curv",
    "end",
    "cstype",
    "bevel",
    "#",
    "F",
    "V",
    "fx",
    "vv",
]


def mutate_lines(random: Random, lines: list[str], mutations: int) -> None:
    """Change some lines."""
    for _ in range(mutations):
        k = random.randrange(len(lines) or 1)
        if not lines:
            return
        some = lines[k].split(" ")
        at = random.randrange(len(some))
        match random.choice(
            [
                "copy",
                "remove",
                "move",
                "name",
                "number",
                "number",
                "number",
                "blank",
                "blank",
                "join",
                "cut",
                "slash",
            ]
        ):
            case "copy":
                lines.insert(random.randint(0, len(lines)), lines[k])
            case "remove":
                del lines[k]
            case "move":
                lines.insert(random.randint(0, len(lines) - 1), lines.pop(k))
            case "name":
                some[0] = random.choice(
                    (*OBJ_NAMES, "facet", "endsolid", "solid", "vertex", "property", "element", "comment")
                )
                lines[k] = " ".join(some)
            case "number":
                some[at] = random.choice(
                    ("", "0", some[at] + " 1", some[at] + " " + some[at], some[at] + "0", *ODD_NUMBERS)
                )
                lines[k] = " ".join(some)
            case "blank":
                blank = random.choice(ODD_BLANKS)
                lines[k] = (
                    lines[k].replace(" ", blank, random.choice((1, -1)))
                    if random.random() < 0.7
                    else lines[k] + blank
                )
            case "join" if k + 1 < len(lines):
                lines[k : k + 2] = [
                    lines[k] + random.choice((" ", "", " \\\n", "\\\n", "#", "\r")) + lines[k + 1]
                ]
            case "cut":
                lines[k] = " ".join(some[: at + 1])
            case "slash":
                some[at] += random.choice(
                    ("/", "//", "/1", "//1", "/0", "/9", "//9", "/1/1/1", "/x", "#", "\\")
                )
                lines[k] = " ".join(some)


def finished(random: Random, lines: list[str], mutations: int) -> bytes:
    """A text from its lines."""
    end = random.choice(("\n", "\n", "\r\n", "\r") if mutations or lines[0] != "ply" else ("\n", "\r\n"))
    told = end.join(lines).replace("\\\n", "\\" + end) + random.choice((end, ""))
    text = random.choice(("", "", "", "\ufeff") if mutations else ("",)).encode() + told.encode(
        "latin-1" if mutations and random.random() < 0.1 and max(told, default="a") < "\u0100" else "utf-8"
    )
    return mutate_bytes(random, text) if mutations and random.random() < 0.1 else text


PLY_TYPES = {
    "char": "b",
    "uchar": "B",
    "short": "h",
    "ushort": "H",
    "int": "i",
    "uint": "I",
    "float": "f",
    "double": "d",
}
PLY_TYPES |= {
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "float32": "f",
    "float64": "d",
}


def ply(random: Random, mutations: int) -> bytes:
    """A file of Stanford."""
    shape, form = Shape(random), random.choice(("ascii", "binary_little_endian", "binary_big_endian"))
    real = random.choice(("float", "double", "float32", "float64"))
    number = random.choice(("uchar", "uint8", "int", "ushort", "uint32", "char"))
    index = random.choice(("int", "uint", "uchar", "short", "int32", "uint16", "uint8"))
    vertex = [(real, name) for name in "xyz"] + random.choice(
        (
            [],
            [("uchar", "red"), ("uchar", "green"), ("uchar", "blue")],
            [("float", "nx")],
            [("double", "quality"), ("short", "n")],
        )
    )
    if random.random() < 0.2:
        random.shuffle(vertex)
    face = [f"list {number} {index} {random.choice(('vertex_indices', 'vertex_index'))}"]
    face += random.choice(
        ([], ["uchar red"], ["list uchar float texcoord"], ["float quality", "list uint8 int16 more"])
    )
    if random.random() < 0.3:
        random.shuffle(face)
    elements = list[tuple[str, list[str], list[list[Any]]]]()
    elements.append(
        (
            "vertex",
            [f"{kind} {name}" for kind, name in vertex],
            [
                [point["xyz".index(name)] if name in ("x", "y", "z") else 7 for _, name in vertex]
                for point in shape.points
            ],
        )
    )
    elements.append(
        (
            "face",
            face,
            [
                [polygon if "vertex_ind" in each else [1, 2] if each[:4] == "list" else 3 for each in face]
                for polygon in shape.polygons
            ],
        )
    )
    if random.random() < 0.3:
        other = random.choice((["int a", "int b"], ["list uchar int a"]))
        elements.insert(
            random.randint(0, 2),
            ("edge", other, [[[0, 1] if each[:4] == "list" else 1 for each in other]] * 2),
        )
    lines = ["ply", f"format {form} 1.0", *random.choice(([], ["comment made"], ["obj_info 3"]))]
    for name, properties, rows in elements:
        lines += [f"element {name} {len(rows)}", *(f"property {each}" for each in properties)]
    lines += ["end_header"]
    if form == "ascii":
        for _, properties, rows in elements:
            for row in rows:
                lines.append(
                    " ".join(
                        _ply_words(random, each, value) for each, value in zip(properties, row, strict=True)
                    )
                )
        mutate_lines(random, lines, mutations)
        return finished(random, lines, mutations)
    order, body = "<>"[form == "binary_big_endian"], b""
    for _, properties, rows in elements:
        for row in rows:
            for each, value in zip(properties, row, strict=True):
                kind = each.split()
                values = value if isinstance(value, list) else [value]
                if kind[0] == "list":
                    body += struct.pack(order + PLY_TYPES[kind[1]], len(values))
                body += struct.pack(f"{order}{len(values)}{PLY_TYPES[kind[-2]]}", *values)
    header_mutations = sum(random.random() < 0.6 for _ in range(mutations))
    mutate_lines(random, lines, header_mutations)
    end = random.choice(("\n", "\n", "\r\n"))
    text = (end.join(lines) + end).encode() + body
    for _ in range(mutations - header_mutations):
        text = mutate_bytes(random, text)
    return text


def _ply_words(random: Random, kind: str, value: Any) -> str:
    real = kind.split()[-2] in ("float", "double", "float32", "float64")
    values = value if isinstance(value, list) else [value]
    told = [word(random, float(each)) if real else str(each) for each in values]
    return " ".join([str(len(values)), *told] if kind.startswith("list") else told)


def stl(random: Random, mutations: int) -> bytes:
    """A file of a stereolithograph."""
    bodies = [
        [[[_coordinate(random) for _ in range(3)] for _ in range(3)] for _ in range(random.randint(1, 3))]
        for _ in range(random.randint(1, 3))
    ]
    if random.random() < 0.4:
        body = b""
        triangles = [each for some in bodies for each in some]
        for triangle in triangles:
            body += np.array([_normal(triangle), *triangle], "<f4").tobytes() + struct.pack(
                "<H", random.choice((0, 0, 7))
            )
        head = random.choice((b"binary", b"solid", b"solid a\nfacet", b"")).ljust(
            80, random.choice((b" ", b"\0"))
        )
        text = head + struct.pack("<I", len(triangles)) + body
        for _ in range(mutations):
            text = mutate_bytes(random, text)
        return text
    lines, indent = list[str](), random.choice(("", "  ", "\t"))
    for k, some in enumerate(bodies):
        name = random.choice(("", " a", " two words", f" body{k}"))
        lines.append(f"solid{name}")
        for triangle in some:
            lines += [f"{indent}facet normal {words(random, _normal(triangle))}", f"{indent}outer loop"]
            lines += [f"{indent}vertex {words(random, each)}" for each in triangle]
            lines += [f"{indent}endloop", f"{indent}endfacet"]
        lines.append(f"endsolid{random.choice((name, ''))}")
    mutate_lines(random, lines, mutations)
    return finished(random, lines, mutations)


def _normal(triangle: list[list[float]]) -> list[float]:
    a, b, c = np.array(triangle)
    across = np.cross(b - a, c - a)
    length = float(np.linalg.norm(across))
    return [float(f"{each:.9g}") for each in across / length] if length else [0.0, 0.0, 0.0]


def mutate_bytes(random: Random, text: bytes) -> bytes:
    """Change some bytes."""
    at, length = random.randint(0, len(text)), random.choice((1, 1, 2, 4, 12, 50))
    match random.choice(["cut", "extend", "remove", "insert", "set", "set", "flip", "flip"]):
        case "cut":
            return text[:-length]
        case "extend":
            return text + random.choice((b"\0", b"\n", b" ", b"f 1 2 3\n", b"\0" * 50, b"x", b"\r\n"))
        case "remove":
            return text[:at] + text[at + length :]
        case "insert":
            return (
                text[:at]
                + random.choice((b"\0", b" ", b"\xa0", b"\r", b"0", b"<!-- -->", b"\xff"))
                + text[at:]
            )
        case "set":
            return (
                text[:at] + bytes([random.choice((0, 1, 2, 3, 32, 48, 127, 128, 192, 255))]) + text[at + 1 :]
            )
        case _:
            return (
                text[:at] + bytes([text[at] ^ (1 << random.randrange(8))]) + text[at + 1 :]
                if at < len(text)
                else text
            )


MAKERS: Mapping[str, Callable[[Random, int], bytes]] = {
    "dae": dae,
    "glb": glb,
    "obj": obj,
    "ply": ply,
    "stl": stl,
}
"""Each makes a file from a random generator and a number of mutations: none makes a valid file."""
