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
    Py_ssize_t (*PyTuple_Size)(PyObject *);
    PyObject *(*PyTuple_GetItem)(PyObject *, Py_ssize_t);
    PyObject *(*PyErr_Occurred)(void);
    PyObject *(*PyErr_Format)(PyObject *, const char *, ...);
    void *(*PyEval_SaveThread)(void);
    void (*PyEval_RestoreThread)(void *);
    int (*PyGILState_Ensure)(void);
    void (*PyGILState_Release)(int);
    int (*PyErr_CheckSignals)(void);
    void (*Py_IncRef)(PyObject *);
    PyObject *none;
    PyObject *type_error;
} api;

/* Whether a handler of a signal has raised, which a long loop asks at each step. */
CC_INLINE bool cc_interrupted(int64_t step)
{
    if ((step & 16383) != 16383) {
        return false;
    }
    const int held = api.PyGILState_Ensure();
    const bool raised = api.PyErr_CheckSignals() != 0;
    api.PyGILState_Release(held);
    return raised;
}

enum { CC_MOST_PARTS = 160 };

/* A number of an argument or a result: an array is its address and its sizes. */
typedef union {
    double d;
    int64_t i;
    void *p;
} Cell;

/* What a call has read, and has borrowed, to be given back when it ends. */
typedef struct {
    Py_buffer views[CC_MOST_PARTS];
    Cell cells[CC_MOST_PARTS];
    int view_count;
    int cell_count;
    bool failed;
} Call;

static void fail(Call *call, const char *name, const char *what)
{
    char named[64] = {0};
    call->failed = true;
    memcpy(named, name, strcspn(name, " ") < 63 ? strcspn(name, " ") : 63);
    api.PyErr_Format(api.type_error, "`%s` must be %s", named, what);
}

/* Take an array as its specification says: kind of number, size in bytes, dimensions,
   and `w` if it is written. */
static void take_array(Call *call, PyObject *given, const char *wanted, const char *name)
{
    Py_buffer *view = &call->views[call->view_count];
    const int is_written = wanted[3] == 'w', dims = wanted[2] - '0';
    const bool is_array = api.PyObject_GetBuffer(given, view, 0x3c | is_written) == 0;
    call->view_count += is_array ? 1 : 0;
    const char *format = is_array && view->format != NULL ? view->format : "B";
    format += *format == '@' || *format == '=' || *format == '<' ? 1 : 0;
    const char *const kind = strchr("dflqbihLQBI?", *format);
    const char found = *format == '\0' || kind == NULL ? ' '
        : *format == '?' ? 'b' : *format == 'd' || *format == 'f' ? 'f'
        : *format >= 'a' ? 'i' : 'u';
    if (!is_array || found != wanted[0] || view->itemsize != wanted[1] - '0'
        || view->ndim != dims) {
        char what[96] = "a contiguous array of ";
        const char *const numbers = wanted[0] == 'f' ? "float64 of "
            : wanted[0] == 'b' ? "bool of "
            : wanted[0] == 'u' ? (wanted[1] == '8' ? "uint64 of " : "uint8 of ")
            : wanted[1] == '8' ? "int64 of " : "int8 of ";
        strcat(what, numbers);
        strncat(what, wanted + 2, 1);
        strcat(what, dims == 1 ? " dimension" : " dimensions");
        strcat(what, is_written ? " that can be written" : "");
        fail(call, name, what);
        return;
    }
    call->cells[call->cell_count++].p = view->buf;
    for (int i = 0; i < dims; i++) {
        call->cells[call->cell_count++].i = view->shape[i];
    }
}

static void take_number(Call *call, PyObject *given, char kind, const char *name)
{
    Cell *cell = &call->cells[call->cell_count++];
    if (kind == 'd') {
        cell->d = api.PyFloat_AsDouble(given);
        if (cell->d < 0.0 && api.PyErr_Occurred() != NULL) { /* -1 where it fails */
            fail(call, name, "a number");
        }
        return;
    }
    cell->i = kind == 'i' ? api.PyLong_AsLongLong(given) : api.PyObject_IsTrue(given);
    if (cell->i == -1 && api.PyErr_Occurred() != NULL) {
        fail(call, name, kind == 'i' ? "an integer" : "true or false");
    }
}

/* Take an argument: its kind, its name and a space; `(` begins a tuple, `)` ends it. */
static void take(Call *call, const char **format, PyObject *given)
{
    const char *const kind = *format, *const name = kind + (*kind == '[' ? 5 : 1);
    *format = strchr(name, ' ') + 1;
    if (*kind == '[') {
        take_array(call, given, kind + 1, name);
    } else if (*kind != '(') {
        take_number(call, given, *kind, name);
    } else {
        const Py_ssize_t size = api.PyTuple_Size(given); /* -1 where it is none */
        Py_ssize_t i = 0;
        for (; **format != ')' && !call->failed && i < size; i++) {
            take(call, format, api.PyTuple_GetItem(given, i));
        }
        if (!call->failed && (**format != ')' || i != size)) {
            fail(call, name, "a tuple with all of its fields");
        }
        ++*format;
    }
}

/* Make the object of a result; of a tuple, `(` and its size as a letter come first. */
static PyObject *make(const char **format, const Cell **cell)
{
    const char kind = *(*format)++;
    if (kind == '(') {
        const Py_ssize_t size = *(*format)++ - 'a';
        PyObject *made = api.PyTuple_New(size);
        for (Py_ssize_t i = 0; i < size; i++) {
            (void)api.PyTuple_SetItem(made, i, make(format, cell));
        }
        return made;
    }
    if (kind == '\0') {
        api.Py_IncRef(api.none);
        return api.none;
    }
    const Cell found = *(*cell)++;
    return kind == 'd' ? api.PyFloat_FromDouble(found.d)
        : kind == 'b' ? api.PyBool_FromLong(found.i != 0)
        : api.PyLong_FromLongLong(found.i);
}

static PyObject *run(void (*function)(const Cell *, Cell *), const char *format,
                     const char *result, Py_ssize_t due, PyObject *const *args,
                     Py_ssize_t count)
{
    Call call;
    PyObject *made = NULL;
    call.view_count = call.cell_count = 0;
    call.failed = count != due;
    if (call.failed) {
        api.PyErr_Format(api.type_error, "%zd arguments are given where %zd are due",
                         count, due);
    }
    for (Py_ssize_t i = 0; i < due && !call.failed; i++) {
        take(&call, &format, args[i]);
    }
    if (!call.failed) {
        Cell found[CC_MOST_PARTS];
        const Cell *cell = found;
        void *thread = api.PyEval_SaveThread();
        function(call.cells, found);
        api.PyEval_RestoreThread(thread);
        made = api.PyErr_Occurred() == NULL ? make(&result, &cell) : NULL;
    }
    while (call.view_count > 0) {
        api.PyBuffer_Release(&call.views[--call.view_count]);
    }
    return made;
}

#define CC_ENTRY(name, format, due, result)                                \
    CC_COLD static PyObject *py_##name(PyObject *self,                     \
                                       PyObject *const *args,              \
                                       Py_ssize_t count)                   \
    {                                                                      \
        (void)self;                                                        \
        return run(call_##name, format, result, due, args, count);         \
    }
