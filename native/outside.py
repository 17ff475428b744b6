"""All symbols that a library of kernels may import; tests check it, and on Windows the linker gets this list."""

from __future__ import annotations

PYTHON = [
    "PyArg_ParseTuple",
    "PyBool_FromLong",
    "PyBuffer_Release",
    "PyBytes_AsStringAndSize",
    "PyCMethod_New",
    "PyCapsule_GetPointer",
    "PyCapsule_New",
    "PyErr_Clear",
    "PyErr_Format",
    "PyErr_NoMemory",
    "PyErr_Occurred",
    "PyErr_SetString",
    "PyEval_RestoreThread",
    "PyEval_SaveThread",
    "PyFloat_AsDouble",
    "PyFloat_FromDouble",
    "PyLong_AsLongLong",
    "PyLong_FromLong",
    "PyLong_FromLongLong",
    "PyLong_FromVoidPtr",
    "PyMem_Free",
    "PyMem_Malloc",
    "PyModuleDef_Init",
    "PyModule_AddStringConstant",
    "PyObject_Call",
    "PyObject_GetBuffer",
    "PyObject_IsTrue",
    "PyTuple_GetItem",
    "PyTuple_New",
    "PyTuple_SetItem",
    "PyTuple_Size",
    "PyType_GetFlags",
    "_Py_Dealloc",
]
"""Functions of Python that `door.c` calls; all are in the stable ABI of 3.11."""

PYTHON_DATA = ["PyExc_LookupError", "PyExc_TypeError", "PyExc_ValueError", "_Py_NoneStruct"]
"""Variables of Python that it uses; also in the stable ABI."""

MATHEMATICS = ["acos", "asin", "atan2", "cos", "pow", "sin", "sincos"]
"""Functions that kernels call. LLVM replaces a sine and a cosine by one `sincos` if the system has it."""

MEMORY = ["free", "malloc", "memcpy", "memset", "strcmp"]
"""Functions of the C library that kernels, `door.c` and `runtime.c` call."""

SYSTEM = [
    "__cxa_finalize",
    "__gmon_start__",
    "_ITM_deregisterTMCloneTable",
    "_ITM_registerTMCloneTable",
    "__stack_chk_fail",
    "__sincos_stret",
    "_memcpy_chk",
    "dyld_stub_binder",
    "bzero",
    "memset_pattern16",
]
"""Symbols that compilers and linkers add."""

ALLOWED = frozenset([*PYTHON, *PYTHON_DATA, *MATHEMATICS, *MEMORY, *SYSTEM])
