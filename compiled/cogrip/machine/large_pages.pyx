"""`large_pages.py`, compiled, for Linux with glibc (docs/decisions/0031-large-pages.md).

Python's objects of up to 512 bytes lie in arenas, larger ones in the C library's heap: both get memory for which `madvise` has
asked for large pages. The kernel gives what it has, when such a page is first touched.
"""

from libc.stdint cimport uintptr_t
from libc.stdlib cimport free, malloc

cdef extern from "<sys/mman.h>" nogil:
    void *mmap(void *, size_t, int, int, int, long)
    int munmap(void *, size_t)
    int mprotect(void *, size_t, int)
    int madvise(void *, size_t, int)
    void *MAP_FAILED
    int MAP_ANONYMOUS, MAP_PRIVATE, PROT_NONE, PROT_READ, PROT_WRITE, MADV_HUGEPAGE

cdef extern from "<unistd.h>" nogil:
    void *sbrk(long)

cdef extern from *:
    """
    #if defined(__GLIBC__)
    #include <malloc.h>
    #else
    enum { M_TOP_PAD, M_TRIM_THRESHOLD, M_MMAP_THRESHOLD };
    static int mallopt(int what, int value) { return 0; }
    #endif
    """
    int M_TOP_PAD, M_TRIM_THRESHOLD, M_MMAP_THRESHOLD
    int mallopt(int, int) nogil

cdef extern from "<Python.h>":
    ctypedef struct PyObjectArenaAllocator:
        void *ctx
        void *(*alloc)(void *, size_t)
        void (*free)(void *, void *, size_t)
    void PyObject_SetArenaAllocator(PyObjectArenaAllocator *)

cdef enum:
    LARGE = 2 << 20
    HEAP = 32 << 20  # of a server with some 500 people, and what their handshakes take meanwhile
    PIECE = 64 << 10  # less than what the C library maps by itself
    MOST_PIECES = 64
    DEFAULT_PAD = 128 << 10  # of glibc
    MAPPED = 32 << 20  # its greatest threshold, to which it would go by itself: a mapping a block costs page faults each time
    NEVER = 0x7FFFFFFF

SETTING = "/sys/kernel/mm/transparent_hugepage/enabled"

cdef char *_next = NULL  # what is free of the newest large page
cdef char *_end = NULL
cdef bint _used = False


def large_pages_permission():
    try:
        with open(SETTING, encoding="ascii") as file:
            return f"no, {SETTING} says never (madvise will do)" if "[never]" in file.read() else "yes"
    except OSError:
        return "no, this kernel has none"


def use_large_pages():
    global _used
    if not _used and large_pages_permission() == "yes":
        _used = True
        _use_for_objects()
        _use_for_heap()


def uses_large_pages():
    return _used


cdef void _use_for_objects() noexcept:
    cdef PyObjectArenaAllocator arenas
    arenas.ctx, arenas.alloc, arenas.free = NULL, _take, _give_back
    PyObject_SetArenaAllocator(&arenas)


cdef void *_take(void *context, size_t size) noexcept:
    """Return memory for an arena, NULL where there is none."""
    global _next, _end
    cdef char *found
    if size > <size_t>(_end - _next):
        found = _large_page() if size <= LARGE else NULL
        if found == NULL:
            found = <char *>mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0)
            return NULL if found == MAP_FAILED else found
        _next, _end = found, found + LARGE
    found = _next
    _next += size
    return found


cdef char *_large_page() noexcept:
    # Not accessible at first: where all memory is locked the kernel would fill it with small pages at once.
    cdef char *region = <char *>mmap(NULL, 2 * LARGE, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0)
    cdef char *page
    if region == MAP_FAILED:
        return NULL
    page = _aligned(region)
    if page > region:
        munmap(region, page - region)
    munmap(page + LARGE, region + LARGE - page)
    madvise(page, LARGE, MADV_HUGEPAGE)
    if mprotect(page, LARGE, PROT_READ | PROT_WRITE):
        munmap(page, LARGE)
        return NULL
    return page


cdef void _give_back(void *context, void *start, size_t size) noexcept:
    munmap(start, size)  # an arena from before, too: those are mapped the same way


cdef void _use_for_heap() noexcept:
    """Extend the heap once by what will be needed: it keeps that, and later parts have small pages."""
    cdef char *before = <char *>sbrk(0)
    cdef char *after
    cdef void *pieces[MOST_PIECES]
    cdef int count = 0
    if not (mallopt(M_TRIM_THRESHOLD, NEVER) and mallopt(M_TOP_PAD, HEAP)):
        return
    mallopt(M_MMAP_THRESHOLD, MAPPED)
    while count < MOST_PIECES and <char *>sbrk(0) == before:
        pieces[count] = malloc(PIECE)
        count += 1
    while count:
        count -= 1
        free(pieces[count])
    mallopt(M_TOP_PAD, DEFAULT_PAD)
    before, after = _aligned(before), <char *>(<uintptr_t>sbrk(0) & ~<uintptr_t>(LARGE - 1))
    if after > before:
        madvise(before, after - before, MADV_HUGEPAGE)


cdef char *_aligned(char *address) noexcept:
    return <char *>((<uintptr_t>address + LARGE - 1) & ~<uintptr_t>(LARGE - 1))
