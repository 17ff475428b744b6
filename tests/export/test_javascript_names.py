"""kinseek.js names arguments of kernels as Python does. `test_javascript` runs the script, and takes minutes."""

import re

import kinseek
from kinseek.export.javascript import SCRIPT, arms_as_data


def test_arguments_named_in_the_script_are_arguments_of_kernels() -> None:
    entries = arms_as_data([kinseek.load("planar2")])["entries"].values()
    known = {path for entry in entries for path, *_ in entry["takes"]}
    named = set(re.findall(r'"(question\.[a-z_.]+)"', SCRIPT.read_text(encoding="utf-8")))
    assert named
    assert named <= known
