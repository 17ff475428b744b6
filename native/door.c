/* The module that Python imports: callables that check their arguments, pass them to a kernel by address, and release the
   GIL while it runs. */
#define Py_LIMITED_API 0x030B0000
#include <Python.h>
#include <stdint.h>
#include <string.h>
#include "door.h"
#if defined(__x86_64__) || defined(_M_X64)
#include <cpuid.h>
#endif

#define MOST_ARRAYS 96
#define MOST_SLOTS 384
#define MOST_NAMES 32
#define MOST_RESULTS 8

enum { FLOAT, INTEGER, FLAG, ARRAY, BUNDLE };  /* As src/kinseek/kernels/backend.py writes them. */

typedef struct {
    int32_t (*code)(int64_t *);
    PyObject *explain;  /* Called with arguments that do not fit; raises a TypeError that says why. */
    int arguments, results;
    int32_t result_kind[MOST_RESULTS];
    int32_t program[];
} Entry;

typedef struct {
    int64_t slot[MOST_SLOTS];
    int64_t named[MOST_NAMES];
    Py_buffer held[MOST_ARRAYS];
    int slots, arrays;
} Call;

static const int32_t *take(Call *call, const int32_t *at, PyObject *value);

static const int32_t *take_array(Call *call, const int32_t *at, PyObject *value) {
    int32_t element = *at++, dimensions = *at++, written = *at++;
    Py_buffer *view = &call->held[call->arrays];
    if (PyObject_GetBuffer(value, view, PyBUF_ND | PyBUF_FORMAT | (written ? PyBUF_WRITABLE : 0))) return NULL;
    call->arrays++;
    const char *format = view->format ? view->format : "B";
    int fits = view->ndim == dimensions && format[1] == 0 &&
               (element == FLOAT ? format[0] == 'd'
                : element == INTEGER ? (format[0] == 'l' || format[0] == 'q') && view->itemsize == 8
                                     : format[0] == '?');
    if (!fits) return NULL;
    call->slot[call->slots++] = (int64_t)(intptr_t)view->buf;
    for (int i = 0; i < dimensions; i++) {
        int32_t name = *at++, plus = *at++;
        int64_t length = view->shape[i];
        if (name == -1 && length != plus) return NULL;
        if (name >= 0) {
            if (call->named[name] < 0) call->named[name] = length - plus;
            if (call->named[name] != length - plus || length < plus) return NULL;
        }
        call->slot[call->slots++] = length;
    }
    return at;
}

static const int32_t *take(Call *call, const int32_t *at, PyObject *value) {
    switch (*at++) {
    case FLOAT: {
        double number = PyFloat_AsDouble(value);
        if (number == -1.0 && PyErr_Occurred()) return NULL;
        memcpy(&call->slot[call->slots++], &number, 8);
        return at;
    }
    case INTEGER: {
        long long number = PyLong_AsLongLong(value);
        if (number == -1 && PyErr_Occurred()) return NULL;
        call->slot[call->slots++] = number;
        return at;
    }
    case FLAG: {
        int truth = PyObject_IsTrue(value);
        if (truth < 0) return NULL;
        call->slot[call->slots++] = truth;
        return at;
    }
    case ARRAY:
        return take_array(call, at, value);
    default: {
        int32_t fields = *at++;
        if (!PyTuple_Check(value) || PyTuple_Size(value) != fields) return NULL;
        for (int32_t i = 0; i < fields && at; i++) at = take(call, at, PyTuple_GetItem(value, i));
        return at;
    }
    }
}

static PyObject *result(int32_t kind, int64_t slot) {
    if (kind == INTEGER) return PyLong_FromLongLong(slot);
    if (kind == FLAG) return PyBool_FromLong(slot != 0);
    double number;
    memcpy(&number, &slot, 8);
    return PyFloat_FromDouble(number);
}

static PyObject *results(const Entry *entry, const int64_t *slot) {
    if (entry->results == 0) Py_RETURN_NONE;
    if (entry->results == 1) return result(entry->result_kind[0], slot[0]);
    PyObject *all = PyTuple_New(entry->results);
    for (int i = 0; all && i < entry->results; i++) {
        PyObject *one = result(entry->result_kind[i], slot[i]);
        if (!one) Py_CLEAR(all);
        else PyTuple_SetItem(all, i, one);
    }
    return all;
}

static PyObject *misfit(const Entry *entry, PyObject *const *args, Py_ssize_t count) {
    PyErr_Clear();
    PyObject *given = PyTuple_New(count), *said = NULL;
    for (Py_ssize_t i = 0; given && i < count; i++) {
        Py_INCREF(args[i]);
        PyTuple_SetItem(given, i, args[i]);
    }
    if (given) said = PyObject_Call(entry->explain, given, NULL);
    Py_XDECREF(given);
    Py_XDECREF(said);
    if (!PyErr_Occurred()) PyErr_SetString(PyExc_TypeError, "a kernel was given what it does not take");
    return NULL;
}

static PyObject *call_entry(PyObject *self, PyObject *const *args, Py_ssize_t count) {
    const Entry *entry = PyCapsule_GetPointer(self, "kinseek.entry");
    if (!entry) return NULL;
    Call call;
    call.slots = call.arrays = 0;
    for (int i = 0; i < MOST_NAMES; i++) call.named[i] = -1;
    const int32_t *at = count == entry->arguments ? entry->program : NULL;
    for (Py_ssize_t i = 0; i < count && at; i++) at = take(&call, at, args[i]);
    PyObject *answer = NULL;
    if (at) {
        int32_t status;
        Py_BEGIN_ALLOW_THREADS
        status = entry->code(call.slot);
        Py_END_ALLOW_THREADS
        if (status == 0) answer = results(entry, call.slot + call.slots);
        else PyErr_NoMemory();  /* Nothing else fails inside a kernel. */
    }
    for (int i = 0; i < call.arrays; i++) PyBuffer_Release(&call.held[i]);
    return at ? answer : misfit(entry, args, count);
}

static PyMethodDef caller = {"kernel", (PyCFunction)(void (*)(void))call_entry, METH_FASTCALL, NULL};

static void forget(PyObject *capsule) {
    Entry *entry = PyCapsule_GetPointer(capsule, "kinseek.entry");
    Py_XDECREF(entry->explain);
    PyMem_Free(entry);
}

static const Symbol *find(const char *name, long level) {
    for (const Symbol *one = symbols; one->name; one++)
        if (one->level == level && !strcmp(one->name, name)) return one;
    PyErr_Format(PyExc_LookupError, "the library has no %s", name);
    return NULL;
}

/* entry(name, level, arguments, program as bytes of 32-bit integers, results as the same, explain) -> a callable */
static PyObject *make_entry(PyObject *self, PyObject *args) {
    const char *name;
    char *program, *kinds;
    long level;
    int arguments;
    Py_ssize_t length, results;
    PyObject *explain, *code, *returned;
    /* Not "#": before Python 3.13 that called another function, and the library has to run with all versions. */
    if (!PyArg_ParseTuple(args, "sliSSO", &name, &level, &arguments, &code, &returned, &explain)) return NULL;
    if (PyBytes_AsStringAndSize(code, &program, &length) || PyBytes_AsStringAndSize(returned, &kinds, &results)) return NULL;
    const Symbol *symbol = find(name, level);
    if (!symbol) return NULL;
    if (results > (Py_ssize_t)sizeof(int32_t) * MOST_RESULTS) return PyErr_Format(PyExc_ValueError, "%s returns too much", name);
    int32_t slots = 0, arrays = 0, highest = -1;
    for (Py_ssize_t i = 0; i < length / 4;) {  /* The longest call has to fit into `Call`. */
        int32_t op = ((const int32_t *)program)[i++];
        if (op == BUNDLE) i++;
        else slots++;
        if (op != ARRAY) continue;
        arrays++;
        int32_t dimensions = ((const int32_t *)program)[i + 1];
        for (int32_t d = 0; d < dimensions; d++) {
            int32_t named = ((const int32_t *)program)[i + 3 + 2 * d];
            highest = named > highest ? named : highest;
        }
        slots += dimensions;
        i += 3 + 2 * dimensions;
    }
    if (slots + MOST_RESULTS > MOST_SLOTS || arrays > MOST_ARRAYS || highest >= MOST_NAMES)
        return PyErr_Format(PyExc_ValueError, "%s takes too much", name);
    Entry *entry = PyMem_Malloc(sizeof(Entry) + (size_t)length);
    if (!entry) return PyErr_NoMemory();
    entry->code = (int32_t (*)(int64_t *))symbol->code;
    entry->explain = explain;
    Py_INCREF(explain);
    entry->arguments = arguments;
    entry->results = (int)(results / 4);
    memcpy(entry->result_kind, kinds, (size_t)results);
    memcpy(entry->program, program, (size_t)length);
    PyObject *capsule = PyCapsule_New(entry, "kinseek.entry", forget);
    if (!capsule) return NULL;
    PyObject *made = PyCFunction_NewEx(&caller, capsule, NULL);
    Py_DECREF(capsule);
    return made;
}

static PyObject *address(PyObject *self, PyObject *args) {
    const char *name;
    long level;
    if (!PyArg_ParseTuple(args, "sl", &name, &level)) return NULL;
    const Symbol *symbol = find(name, level);
    return symbol ? PyLong_FromVoidPtr((void *)symbol->code) : NULL;
}

#if defined(__x86_64__) || defined(_M_X64)
/* The highest level of this processor. `__builtin_cpu_supports` always returns 0 in a library that zig links. */
static int level(void) {
    unsigned a, b, c, d, low, high;
    const unsigned v2 = bit_SSE3 | bit_SSSE3 | bit_CMPXCHG16B | bit_SSE4_1 | bit_SSE4_2 | bit_POPCNT;
    const unsigned v3 = bit_FMA | bit_MOVBE | bit_OSXSAVE | bit_AVX | bit_F16C, v3_too = bit_BMI | bit_AVX2 | bit_BMI2;
    const unsigned v4 = bit_AVX512F | bit_AVX512DQ | bit_AVX512CD | bit_AVX512BW | bit_AVX512VL;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & v2) != v2) return 0;
    if ((c & v3) != v3) return 2;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    const unsigned kept = low & 0xe6;  /* Wide registers that the system saves. */
    if ((kept & 6) != 6) return 2;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || (b & v3_too) != v3_too) return 2;
    const int fourth = (b & v4) == v4 && kept == 0xe6;
    if (!__get_cpuid(0x80000001, &a, &b, &c, &d) || !(c & bit_LZCNT)) return 2;
    return fourth ? 4 : 3;
}
#else
static int level(void) { return 1; }
#endif

static PyObject *best_level(PyObject *self, PyObject *unused) { return PyLong_FromLong(level()); }

static PyMethodDef methods[] = {
    {"entry", make_entry, METH_VARARGS, NULL},
    {"address", address, METH_VARARGS, NULL},
    {"best_level", best_level, METH_NOARGS, NULL},
    {0}};

static int fill(PyObject *module) {
    return PyModule_AddStringConstant(module, "digest", digest) || PyModule_AddStringConstant(module, "levels", levels_built) ||
           PyModule_AddStringConstant(module, "rooms", rooms_built) || PyModule_AddStringConstant(module, "made_of", made_of);
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, (void *)fill}, {0}};
static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_prebuilt", NULL, 0, methods, slots};

PyMODINIT_FUNC PyInit__prebuilt(void) { return PyModuleDef_Init(&definition); }
