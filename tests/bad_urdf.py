"""URDF files that are refused, and why."""

from __future__ import annotations

from robot_files import LIMIT, SECOND, joint, robot

BAD_FILES = {
    "broken XML": ("<robot><link></robot>", "broken XML.*line 1"),
    "empty": ("", "broken XML"),
    "not a robot": ("<sdf/>", "root tag is <sdf>, expected <robot>"),
    "xacro in a .urdf": (
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="x"/></robot>',
        "xacro commands; rename it to .xacro",
    ),
    "xacro of another address in a .urdf": (  # As many files have it: the command was left out.
        robot(joint(inside='<limit lower="-1" upper="1"/>'), '<xacro:hand parent="b"/>', links="a b").replace(
            "<robot", '<robot xmlns:xacro="http://ros.org/wiki/xacro"'
        ),
        "xacro commands; rename it to .xacro",
    ),
    "no links": ("<robot/>", "no links"),
    "nameless link": ("<robot><link/></robot>", "<link> in line 1 has no name"),
    "nameless joint": ('<robot><link name="a"/><joint/></robot>', "<joint> in line 1 has no name"),
    "duplicate link": (robot(joint(), links="a b b"), "duplicate link names: b"),
    "duplicate joint": (robot(joint(), joint(ends="b c")), "duplicate joint names: j"),
    "unknown link": (robot(joint(ends="a z"), links="a b"), "joint 'j' refers to link 'z'"),
    "two parents": (robot(joint(), joint("k", "c b")), "link 'b' has two parents, 'a' and 'c'"),
    "loop of all": (robot(joint(), joint("k", "b a"), links="a b"), "form a loop: a -> b -> a"),
    "loop apart": (
        robot(joint(), joint("k", "c d"), joint("l", "d c"), links="a b c d"),
        "form a loop: c -> d",
    ),
    "several roots": (robot(joint()), "several root links, expected one: a, c"),
    "unknown type": (
        robot(joint(kind="revolut"), SECOND),
        "unknown joint type 'revolut'; did you mean 'revolute'",
    ),
    "no type": (robot(joint().replace(' type="revolute"', ""), SECOND), "joint 'j': no type"),
    "no parent": (robot(joint().replace('<parent link="a"/>', ""), SECOND), "joint 'j': no <parent>"),
    "parent of nothing": (robot(joint().replace('<parent link="a"/>', "<parent/>")), "<parent> has no link"),
    "no child": (robot(joint().replace('<child link="b"/>', ""), SECOND), "joint 'j': no <child>"),
    "no limit": (robot(joint(inside=""), SECOND), "'j' is revolute and needs a <limit> with both"),
    "half a limit": (
        robot(joint(inside='<limit lower="-1"/>'), SECOND),
        "'j' is revolute and needs a <limit>",
    ),
    "prismatic without": (robot(joint(kind="prismatic", inside=""), SECOND), "'j' is prismatic and needs"),
    "inverted": (
        robot(joint(inside='<limit lower="2" upper="1"/>'), SECOND),
        "'j': lower limit 2.0 is above",
    ),
    "infinite": (robot(joint(inside='<limit lower="-inf" upper="1"/>'), SECOND), "'j'.*'-inf' is not finite"),
    "not a number": (robot(joint(inside='<limit lower="${x}" upper="1"/>'), SECOND), "'j'.*is not a number"),
    "underscore": (robot(joint(inside='<limit lower="-1_0" upper="1"/>'), SECOND), "'-1_0' is not a number"),
    "nan origin": (
        robot(joint(inside=LIMIT + '<origin xyz="0 nan 0"/>'), SECOND),
        "<origin> xyz.*not finite",
    ),
    "short origin": (robot(joint(inside=LIMIT + '<origin rpy="0 0"/>'), SECOND), "2 values, expected 3"),
    "two origins": (robot(joint(inside=LIMIT + "<origin/><origin/>"), SECOND), "2 <origin> elements"),
    "quaternion": (
        robot(joint(inside=LIMIT + '<origin quat_xyzw="0 0 0 1"/>'), SECOND),
        "<origin> in line 1 has quat_xyzw, which is not supported, expected rpy",
    ),
    "quaternion of a shape": (
        robot(joint(), SECOND).replace(
            "</robot>", '<link name="d"><collision><origin quat_xyzw=""/></collision></link></robot>'
        ),
        "<origin> in line 1 has quat_xyzw",
    ),
    "another file": (
        '<!DOCTYPE robot [<!ENTITY e SYSTEM "links.xml">]><robot>&e;</robot>',
        "broken XML: Entity 'e' not defined",
    ),
    "empty axis": (robot(joint(inside=LIMIT + "<axis/>"), SECOND), "<axis> has no xyz"),
    "zero axis": (robot(joint(inside=LIMIT + '<axis xyz="0 0 0"/>'), SECOND), "'j': axis 0 0 0 has length 0"),
    "long axis": (
        robot(joint(inside=LIMIT + '<axis xyz="0 2 0"/>'), SECOND),
        "length 2, expected 1; write 0 1 0",
    ),
    "all fixed": (
        robot(joint(kind="fixed", inside=""), SECOND),
        "no movable joint between base 'a' and tip 'c'",
    ),
    "mimic of nothing": (robot(joint(inside=LIMIT + "<mimic/>"), SECOND), "<mimic> has no joint"),
    "mimic unknown": (
        robot(joint(inside=LIMIT + '<mimic joint="z"/>'), SECOND),
        "mimics 'z', which does not move",
    ),
    "mimic of itself": (robot(joint(inside=LIMIT + '<mimic joint="j"/>'), SECOND), "form a loop: j -> j"),
    "bad multiplier": (
        robot(joint(), joint("k", "b c", inside='<mimic joint="j" multiplier="two"/>')),
        "'k': <mimic> multiplier='two': 'two' is not a number",
    ),
}
