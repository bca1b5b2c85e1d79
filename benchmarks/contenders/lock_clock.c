/* Processor time that a process' threads spend between giving the interpreter's lock away and
   asking for it again: preloaded before Python's shared library, by `simulation.py lock`. */
#define _GNU_SOURCE
#include <Python.h>
#include <dlfcn.h>
#include <time.h>

static PyThreadState *(*save)(void);
static void (*restore)(PyThreadState *);
static __thread double since;
static double total;

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

__attribute__((constructor)) static void begin(void) {
    save = dlsym(RTLD_NEXT, "PyEval_SaveThread");
    restore = dlsym(RTLD_NEXT, "PyEval_RestoreThread");
}

PyThreadState *PyEval_SaveThread(void) {
    PyThreadState *state = save();
    since = now();
    return state;
}

void PyEval_RestoreThread(PyThreadState *state) {
    double gone = since > 0.0 ? now() - since : 0.0;
    since = 0.0;
    restore(state);
    total += gone; /* under the lock */
}

double free_seconds(void) { return total; }
