/* Counts, records and fails what a process does to files below a folder: LD_PRELOAD=shim.so.

   The process calls shim_arm(folder, action, at, errno_or_bytes, log) through ctypes, before what is tested:
     action 0   only count and record
     action 1   operation `at` fails once with `number`
     action 2   operation `at` and all later ones that need space fail with `number`
     action 3   the process is killed before operation `at`
     action 4   the disk is full after `number` bytes: later writes are short, then fail with ENOSPC
     action 5   allocation `at` of more than 64 KiB by NumPy fails (at < 0: they are only counted)
   shim_count() returns the number of operations (action 5: allocations) since then. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

static char folder[PATH_MAX];
static int action, number, log_handle = -1;
static long at, bytes_left;
static volatile long count;
static int in_log;

#define REAL(name) static __typeof__(name) *real; if (!real) real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)

static void note(const char *format, ...) {
    char line[2 * PATH_MAX + 100];
    va_list rest;
    if (log_handle < 0) return;
    va_start(rest, format);
    int size = vsnprintf(line, sizeof line, format, rest);
    va_end(rest);
    REAL(write);
    if (size > 0 && real(log_handle, line, size) < 0) abort();
}

void shim_arm(const char *where, int what, long which, int with, const char *log) {
    REAL(open);
    snprintf(folder, sizeof folder, "%s", where);
    at = which, number = with, bytes_left = with, count = 0;
    log_handle = *log ? real(log, O_CREAT | O_WRONLY | O_TRUNC | O_APPEND | O_CLOEXEC, 0600) : -1;
    action = what;
}

void shim_disarm(void) { folder[0] = 0; }
long shim_count(void) { return count; }

static int below(const char *path) {
    return *folder && !strncmp(path, folder, strlen(folder)) && (path[strlen(folder)] == '/' || !path[strlen(folder)]);
}

/* Returns the full path in `full` if it is in the folder. */
static int watched(int base, const char *path, char *full) {
    char link[64], start[PATH_MAX];
    if (!*folder || !path) return 0;
    if (path[0] == '/') return snprintf(full, PATH_MAX, "%s", path), below(full);
    if (base == AT_FDCWD) {
        if (!getcwd(start, sizeof start)) return 0;
    } else {
        snprintf(link, sizeof link, "/proc/self/fd/%d", base);
        ssize_t size = readlink(link, start, sizeof start - 1);
        if (size < 0) return 0;
        start[size] = 0;
    }
    snprintf(full, PATH_MAX, "%.2000s/%.2000s", start, path);
    return below(full);
}

static int watched_handle(int handle, char *full) {
    char link[64];
    if (!*folder) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", handle);
    ssize_t size = readlink(link, full, PATH_MAX - 1);
    if (size < 0) return 0;
    full[size] = 0;
    return below(full);
}

/* Counts an operation; returns whether it fails, with errno set. */
static int fails(int needs_space) {
    if (action == 5) return 0;
    long mine = __sync_add_and_fetch(&count, 1);
    if (action == 3 && mine == at) kill(getpid(), SIGKILL);
    if ((action == 1 && mine == at) || (action == 2 && mine >= at && needs_space)) return errno = number, 1;
    return 0;
}

static int opens(int base, const char *path, int flags) {
    char full[PATH_MAX];
    if (!(flags & (O_CREAT | O_WRONLY | O_RDWR)) || (flags & O_TMPFILE) == O_TMPFILE || !watched(base, path, full)) return 0;
    if (fails(flags & O_CREAT)) return -1;
    if (flags & O_TRUNC) note("truncate\t%s\t0\n", full);
    if (flags & O_CREAT) note("create\t%s\n", full);
    return 0;
}

#define OPEN(name, base, arguments, call) \
    int name arguments { \
        mode_t mode = 0; \
        if (flags & (O_CREAT | O_TMPFILE)) { va_list rest; va_start(rest, flags); mode = va_arg(rest, mode_t); va_end(rest); } \
        REAL(name); \
        return opens(base, path, flags) < 0 ? -1 : real call; \
    }
OPEN(open, AT_FDCWD, (const char *path, int flags, ...), (path, flags, mode))
OPEN(open64, AT_FDCWD, (const char *path, int flags, ...), (path, flags, mode))
OPEN(openat, base, (int base, const char *path, int flags, ...), (base, path, flags, mode))
OPEN(openat64, base, (int base, const char *path, int flags, ...), (base, path, flags, mode))

/* Returns how many bytes may be written, or -1. */
static ssize_t writes(int handle, size_t size) {
    char full[PATH_MAX];
    if (!watched_handle(handle, full)) return size;
    if (fails(1)) return -1;
    if (action == 4) {
        if (bytes_left <= 0 && size) return errno = ENOSPC, -1;
        if ((long)size > bytes_left) size = bytes_left;
        bytes_left -= size;
    }
    note("write\t%s\n", full);
    return size;
}

ssize_t write(int handle, const void *content, size_t size) {
    REAL(write);
    if (handle == log_handle) return real(handle, content, size);
    ssize_t allowed = writes(handle, size);
    return allowed < 0 ? -1 : real(handle, content, allowed);
}

#define PWRITE(name, off) \
    ssize_t name(int handle, const void *content, size_t size, off place) { \
        REAL(name); \
        ssize_t allowed = writes(handle, size); \
        return allowed < 0 ? -1 : real(handle, content, allowed, place); \
    }
PWRITE(pwrite, off_t)
PWRITE(pwrite64, off64_t)

/* NumPy's tofile and SQLite's journal go through these; glibc writes by itself what fwrite was given. */
size_t fwrite(const void *content, size_t size, size_t items, FILE *file) {
    REAL(fwrite);
    ssize_t allowed = writes(fileno(file), size * items);
    if (allowed < 0) return 0;
    return size ? real(content, 1, allowed, file) / size : 0;
}

ssize_t copy_file_range(int source, off64_t *from, int target, off64_t *to, size_t size, unsigned flags) {
    REAL(copy_file_range);
    ssize_t allowed = writes(target, size);
    return allowed < 0 ? -1 : real(source, from, target, to, allowed, flags);
}

#include <sys/sendfile.h>
ssize_t sendfile64(int target, int source, off64_t *from, size_t size) {
    REAL(sendfile64);
    char full[PATH_MAX];
    if (!watched_handle(target, full)) return real(target, source, from, size);
    ssize_t allowed = writes(target, size);
    return allowed < 0 ? -1 : real(target, source, from, allowed);
}
ssize_t sendfile(int target, int source, off_t *from, size_t size) { return sendfile64(target, source, (off64_t *)from, size); }

#define TRUNCATE(name, off) \
    int name(int handle, off size) { \
        REAL(name); \
        char full[PATH_MAX]; \
        if (watched_handle(handle, full)) { if (fails(1)) return -1; note("write\t%s\n", full); } \
        return real(handle, size); \
    }
TRUNCATE(ftruncate, off_t)
TRUNCATE(ftruncate64, off64_t)

#define SYNC(name) \
    int name(int handle) { \
        REAL(name); \
        char full[PATH_MAX]; \
        if (watched_handle(handle, full)) { if (fails(0)) return -1; note("sync\t%s\n", full); } \
        return real(handle); \
    }
SYNC(fsync)
SYNC(fdatasync)

static int renames(int from, const char *source, int to, const char *target) {
    char first[PATH_MAX], second[PATH_MAX];
    if (!watched(to, target, second)) return 0;
    if (fails(0)) return -1;
    if (!watched(from, source, first)) snprintf(first, sizeof first, "%s", source);
    note("rename\t%s\t%s\n", first, second);
    return 0;
}

int rename(const char *source, const char *target) {
    REAL(rename);
    return renames(AT_FDCWD, source, AT_FDCWD, target) < 0 ? -1 : real(source, target);
}
int renameat(int from, const char *source, int to, const char *target) {
    REAL(renameat);
    return renames(from, source, to, target) < 0 ? -1 : real(from, source, to, target);
}

#define NAMED(name, operation, arguments, base, call) \
    int name arguments { \
        REAL(name); \
        char full[PATH_MAX]; \
        if (watched(base, path, full)) { if (fails(0)) return -1; note(operation "\t%s\n", full); } \
        return real call; \
    }
NAMED(unlink, "remove", (const char *path), AT_FDCWD, (path))
NAMED(unlinkat, "remove", (int base, const char *path, int flags), base, (base, path, flags))
NAMED(rmdir, "remove", (const char *path), AT_FDCWD, (path))
NAMED(mkdir, "folder", (const char *path, mode_t mode), AT_FDCWD, (path, mode))
NAMED(mkdirat, "folder", (int base, const char *path, mode_t mode), base, (base, path, mode))

/* Allocations of arrays: those whose caller is NumPy's core. */
/* NumPy 2.4 allocates buffers of 64 KiB without the interpreter's lock, and crashes if there is no memory for them. */
#define LARGE 65536
static int of_numpy(void *caller) {
    static char *begin, *end;
    Dl_info found;
    if ((char *)caller >= begin && (char *)caller < end) return 1;
    if (begin || !dladdr(caller, &found) || !found.dli_fname || !strstr(found.dli_fname, "_multiarray_umath")) return 0;
    begin = found.dli_fbase, end = begin + (64L << 20);
    return 1;
}
static int no_memory(size_t size, void *caller) {
    if (action != 5 || !*folder || size <= LARGE || !of_numpy(caller)) return 0;
    return __sync_add_and_fetch(&count, 1) == at;
}
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
void *malloc(size_t size) {
    return no_memory(size, __builtin_return_address(0)) ? NULL : __libc_malloc(size);
}
void *calloc(size_t items, size_t size) {
    return no_memory(items * size, __builtin_return_address(0)) ? NULL : __libc_calloc(items, size);
}
void *realloc(void *old, size_t size) {
    return no_memory(size, __builtin_return_address(0)) ? NULL : __libc_realloc(old, size);
}
