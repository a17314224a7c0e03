/* Calls from Python: arguments are read and results are made with functions of Python's
   stable interface, which the library is given, so that it links no Python. */

/* Made small rather than fast: what arguments cost is Python's own work. */
#if defined(__GNUC__)
#define CC_COLD __attribute__((cold))
#else
#define CC_COLD
#endif

typedef struct PyObject PyObject;
typedef intptr_t Py_ssize_t;
typedef struct {
    void *buf;
    PyObject *obj;
    Py_ssize_t len;
    Py_ssize_t itemsize;
    int readonly;
    int ndim;
    char *format;
    Py_ssize_t *shape;
    Py_ssize_t *strides;
    Py_ssize_t *suboffsets;
    void *internal;
} Py_buffer;
typedef PyObject *(*PyFunction)(PyObject *, PyObject *const *, Py_ssize_t);
typedef struct {
    const char *name;
    PyFunction call;
    int flags;
    const char *doc;
} PyMethodDef;

static struct {
    int (*PyObject_GetBuffer)(PyObject *, Py_buffer *, int);
    void (*PyBuffer_Release)(Py_buffer *);
    double (*PyFloat_AsDouble)(PyObject *);
    PyObject *(*PyFloat_FromDouble)(double);
    long long (*PyLong_AsLongLong)(PyObject *);
    PyObject *(*PyLong_FromLongLong)(long long);
    PyObject *(*PyBool_FromLong)(long);
    int (*PyObject_IsTrue)(PyObject *);
    PyObject *(*PyTuple_New)(Py_ssize_t);
    int (*PyTuple_SetItem)(PyObject *, Py_ssize_t, PyObject *);
    PyObject *(*PySequence_GetItem)(PyObject *, Py_ssize_t);
    Py_ssize_t (*PySequence_Size)(PyObject *);
    PyObject *(*PyErr_Occurred)(void);
    PyObject *(*PyErr_Format)(PyObject *, const char *, ...);
    void *(*PyEval_SaveThread)(void);
    void (*PyEval_RestoreThread)(void *);
    void (*Py_IncRef)(PyObject *);
    void (*Py_DecRef)(PyObject *);
    PyObject *none;
    PyObject *type_error;
} api;

enum { CC_MOST_VIEWS = 128, CC_MOST_ITEMS = 128 };

/* What a call has borrowed, to be given back when it ends. */
typedef struct {
    Py_buffer views[CC_MOST_VIEWS];
    PyObject *items[CC_MOST_ITEMS];
    int view_count;
    int item_count;
    bool failed;
} Call;

static void end_call(Call *call)
{
    while (call->view_count > 0) {
        api.PyBuffer_Release(&call->views[--call->view_count]);
    }
    while (call->item_count > 0) {
        api.Py_DecRef(call->items[--call->item_count]);
    }
}

static void fail(Call *call, const char *name, const char *what)
{
    if (!call->failed) {
        call->failed = true;
        api.PyErr_Format(api.type_error, "`%s` must be %s", name, what);
    }
}

static void take_array(Call *call, PyObject *given, const char *name, const char *what,
                       char kind, Py_ssize_t size, int dims, int is_written,
                       void **data, int64_t *shape)
{
    Py_buffer *view = &call->views[call->view_count];
    if (call->failed) {
        return;
    }
    if (api.PyObject_GetBuffer(given, view, 0x38 | 0x4 | is_written) != 0) {
        fail(call, name, what);
        return;
    }
    call->view_count++;
    const char *format = view->format;
    if (format != NULL && (*format == '@' || *format == '=' || *format == '<')) {
        format++;
    }
    const char found = format == NULL ? 'B' : *format;
    const char class = found == 'd' ? 'f' : found == '?' ? 'b'
        : found == 'l' || found == 'q' || found == 'b' || found == 'i' ? 'i'
        : found == 'L' || found == 'Q' || found == 'B' ? 'u' : ' ';
    if (class != kind || view->itemsize != size || view->ndim != dims) {
        fail(call, name, what);
        return;
    }
    *data = view->buf;
    for (int i = 0; i < dims; i++) {
        shape[i] = view->shape[i];
    }
}

static double take_real(Call *call, PyObject *given, const char *name)
{
    const double value = api.PyFloat_AsDouble(given);
    if (value < 0.0 && api.PyErr_Occurred() != NULL) { /* -1 where it fails */
        fail(call, name, "a number");
    }
    return value;
}

static int64_t take_int(Call *call, PyObject *given, const char *name)
{
    const int64_t value = api.PyLong_AsLongLong(given);
    if (value == -1 && api.PyErr_Occurred() != NULL) {
        fail(call, name, "an integer");
    }
    return value;
}

static bool take_bool(Call *call, PyObject *given, const char *name)
{
    const int value = api.PyObject_IsTrue(given);
    if (value < 0) {
        fail(call, name, "true or false");
    }
    return value > 0;
}

/* Field of a tuple. */
static PyObject *take_item(Call *call, PyObject *given, Py_ssize_t place, const char *name)
{
    if (call->failed) {
        return given;
    }
    PyObject *item = api.PySequence_GetItem(given, place);
    if (item == NULL) {
        fail(call, name, "a tuple with all of its fields");
        return given;
    }
    call->items[call->item_count++] = item;
    return item;
}

static bool has_count(Call *call, Py_ssize_t given, Py_ssize_t wanted)
{
    if (given == wanted) {
        return true;
    }
    call->failed = true;
    api.PyErr_Format(api.type_error, "%zd arguments are given where %zd are due", given,
                     wanted);
    return false;
}
