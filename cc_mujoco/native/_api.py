"""Functions of Python's stable interface that the native library is given."""

API = (
    "PyObject_GetBuffer", "PyBuffer_Release", "PyFloat_AsDouble", "PyFloat_FromDouble",
    "PyLong_AsLongLong", "PyLong_FromLongLong", "PyBool_FromLong", "PyObject_IsTrue",
    "PyTuple_New", "PyTuple_SetItem", "PySequence_GetItem", "PySequence_Size",
    "PyErr_Occurred", "PyErr_Format", "PyEval_SaveThread", "PyEval_RestoreThread",
    "Py_IncRef", "Py_DecRef",
)  # fmt: skip
"""In the order of the table in `python_calls.h`."""
