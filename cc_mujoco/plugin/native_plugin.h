/* What the plugin's functions use beside native.h. MuJoCo's functions are found when the
   library is loaded, so that it links nothing and serves several releases. */
#ifndef CC_MUJOCO_NATIVE_PLUGIN_H
#define CC_MUJOCO_NATIVE_PLUGIN_H

#include "native.h"

#include <locale.h>
#include <stdlib.h>

typedef struct {
    void *(*mju_malloc)(size_t);
    void (*mju_free)(void *);
    void (*mju_message)(void *);
    void (*mj_solveM)(const void *, void *, double *, const double *, int);
    void (*mj_applyFT)(const void *, void *, const double *, const double *,
                       const double *, int, double *);
    void (*mj_kinematics)(const void *, void *);
    void (*mj_tendon)(const void *, void *);
    void (*mj_fullM)(const void *, const void *, double *);
    void (*mj_mulM)(const void *, void *, double *, const double *);
    int (*mj_isSparse)(const void *);
    int (*mju_cholFactor)(double *, int, double);
    void (*mju_cholSolve)(double *, const double *, const double *, int);
    void (*mj_markStack)(void *);
    void (*mj_freeStack)(void *);
    double *(*mj_stackAllocNum)(void *, size_t);
} Engine;

/* One unit of the library holds what all units share. */
#if defined(__GNUC__)
#define CC_SHARED __attribute__((visibility("hidden")))
#else
#define CC_SHARED
#endif
extern Engine engine CC_SHARED;
/* Offsets in MuJoCo's structures. They are written once, before any function reads them:
   compilers may keep what they have read, as of a constant. */
#if defined(__GNUC__)
#define CC_LAYOUT __asm__("cc_mujoco_offsets") CC_SHARED
extern const Layout layout CC_LAYOUT;
extern Layout written_layout CC_LAYOUT;
#else
extern Layout layout;
#define written_layout layout
#endif

/* Return the value of a decimal number, whose grammar is checked. The point of the host's
   locale may be another one. */
static double decimal_value(Bytes text)
{
    const char *point = localeconv()->decimal_point;
    char *copy = engine.mju_malloc((size_t)text.n + strlen(point) + 1), *end = copy;
    for (int64_t i = 0; i < text.n; i++) {
        if (text.p[i] == '.') {
            strcpy(end, point);
            end += strlen(point);
        } else {
            *end++ = (char)text.p[i];
        }
    }
    *end = 0;
    double value = strtod(copy, NULL);
    engine.mju_free(copy);
    return value;
}

/* Digests of the warnings that this process has issued. */
CC_EXPORT extern int64_t cc_mujoco_said[CC_DIGEST_SLOTS];

#endif
