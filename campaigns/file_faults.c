// File faults: a library for LD_PRELOAD that counts the file operations below a folder, and fails,
// shortens, records or interrupts one of them. It also moves the clock. file_faults.py controls it.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

enum { OPEN = 1, WRITE = 2, RENAME = 4, FSYNC = 8, TRUNCATE = 16, CLOSE = 32, MMAP = 64,
       UNLINK = 128, MKDIR = 256, READ = 512 };
enum { COUNT, FAIL, SHORT, SIGNAL, SIGNAL_AFTER, VANISH };

struct shared { long calls; long first_pid; };

static char root[PATH_MAX];
static size_t root_length;
static int calls, kind, number, lasting, log_file = -1;
static long at;
static struct shared own, *shared = &own;
static long clock_offset, clock_at, clock_reads;
static pthread_mutex_t order = PTHREAD_MUTEX_INITIALIZER;

// Without a folder nothing is counted. A file that processes share holds the count of all of them.
void faults_set(const char *folder, int which, int what, int how, long when, int stays,
                const char *count_file, const char *log_path) {
    snprintf(root, sizeof root, "%s", folder);
    root_length = strlen(root);
    calls = which, kind = what, number = how, at = when, lasting = stays;
    if (count_file[0]) {
        int file = syscall(SYS_openat, AT_FDCWD, count_file, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
        syscall(SYS_ftruncate, file, sizeof(struct shared));
        shared = (struct shared *)syscall(SYS_mmap, 0, sizeof(struct shared),
                                          PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        syscall(SYS_close, file);
    }
    if (log_path[0])
        log_file = syscall(SYS_openat, AT_FDCWD, log_path,
                           O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
}

long faults_calls(void) { return shared->calls; }

// The clock is `offset` seconds off once it has been read `when` times.
void faults_clock(long offset, long when) { clock_offset = offset, clock_at = when; }

// Processes that are started by exec take the settings from the environment.
__attribute__((constructor)) static void from_environment(void) {
    const char *text = getenv("GSFW_FILE_FAULTS");
    char folder[PATH_MAX], count_file[PATH_MAX];
    int which, what, how, stays;
    long when, offset, reads;
    if (text && sscanf(text, "%d %d %d %ld %d %s %s", &which, &what, &how, &when, &stays,
                       count_file, folder) == 7)
        faults_set(folder, which, what, how, when, stays, count_file, "");
    text = getenv("GSFW_CLOCK_FAULT");
    if (text && sscanf(text, "%ld %ld", &offset, &reads) == 2) faults_clock(offset, reads);
}

static int is_below(const char *path) {
    char full[PATH_MAX];
    if (!root_length || !path) return 0;
    if (path[0] != '/') {
        if (syscall(SYS_getcwd, full, sizeof full) < 0) return 0;
        size_t used = strlen(full);
        snprintf(full + used, sizeof full - used, "/%s", path);
        path = full;
    }
    return !strncmp(path, root, root_length) && (!path[root_length] || path[root_length] == '/');
}

static const char *absolute(const char *path, char *full) {
    if (path[0] == '/') return path;
    if (syscall(SYS_getcwd, full, PATH_MAX) < 0) return path;
    size_t used = strlen(full);
    snprintf(full + used, PATH_MAX - used, "/%s", path);
    return full;
}

// Path of an open file, or of a name beside an open folder; empty if it is none.
static const char *path_of(int file, const char *name, char *path) {
    char link[64];
    if (name && (name[0] == '/' || file == AT_FDCWD)) return absolute(name, path);
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = syscall(SYS_readlinkat, AT_FDCWD, link, path, PATH_MAX - 1);
    path[length < 0 ? 0 : length] = 0;
    if (name && length > 0) snprintf(path + length, PATH_MAX - length, "/%s", name);
    return path;
}

static int file_is_below(int file) {
    char path[PATH_MAX];
    return root_length && file > 2 && is_below(path_of(file, 0, path));
}

static void send(void) { syscall(SYS_kill, number == SIGKILL ? 0 : getpid(), number); }

// The fault of this call: 0 for none, else its kind; SIGNAL is sent here.
static int fault(int call) {
    if (!(calls & call)) return 0;
    long count = __atomic_add_fetch(&shared->calls, 1, __ATOMIC_SEQ_CST);
    if (count != at && !(lasting && at > 0 && count > at)) return 0;
    if (kind == SIGNAL && count == at) send();
    if (kind == VANISH && count == at) {
        char away[PATH_MAX];
        snprintf(away, sizeof away, "%.*s.away", PATH_MAX - 8, root);
        syscall(SYS_renameat2, AT_FDCWD, root, AT_FDCWD, away, 0);
    }
    if (kind == FAIL) errno = number;
    return kind;
}

static void after(int what) { if (what == SIGNAL_AFTER) send(); }

// One record: operation, file, place, length, paths; then the bytes that were written.
static void record(const char *operation, long file, long place, const char *from, const char *to,
                   const void *bytes, size_t length) {
    char head[2 * PATH_MAX + 128];
    if (log_file < 0) return;
    int used = snprintf(head, sizeof head, "%s\t%ld\t%ld\t%zu\t%s\t%s\n", operation, file, place,
                        length, from, to);
    struct iovec parts[2] = {{head, used}, {(void *)bytes, length}};
    syscall(SYS_writev, log_file, parts, 2);
}

void faults_mark(const char *text) { record("mark", 0, 0, text, "", 0, 0); }

static long inode(int file) {
    struct stat found;
    return fstat(file, &found) ? 0 : (long)found.st_ino;
}

#define REAL(name, result, ...)                                                     \
    static result (*real)(__VA_ARGS__);                                             \
    if (!real) real = (result(*)(__VA_ARGS__))dlsym(RTLD_NEXT, name)

static int opened(int folder, const char *path, int flags, mode_t mode) {
    char full[PATH_MAX];
    struct stat found;
    const char *whole = root_length ? path_of(folder, path, full) : path;
    int below = root_length && is_below(whole), what = 0, is_new = 0;
    if (below) {
        int writes = (flags & O_ACCMODE) != O_RDONLY || flags & O_CREAT;
        what = fault(writes ? OPEN : READ);
        if (what == FAIL) return -1;
        is_new = flags & O_CREAT && lstat(whole, &found);
    }
    pthread_mutex_lock(&order);
    int file = syscall(SYS_openat, folder, path, flags, mode);
    if (file >= 0 && below && is_new) record("create", inode(file), 0, whole, "", 0, 0);
    if (file >= 0 && below && !is_new && flags & O_TRUNC)
        record("truncate", inode(file), 0, whole, "", 0, 0);
    pthread_mutex_unlock(&order);
    after(what);
    return file;
}

#define MODE                                                                        \
    mode_t mode = 0;                                                                \
    if (flags & O_CREAT || (flags & O_TMPFILE) == O_TMPFILE) {                      \
        va_list rest;                                                               \
        va_start(rest, flags);                                                      \
        mode = va_arg(rest, mode_t);                                                \
        va_end(rest);                                                               \
    }

int open(const char *path, int flags, ...) { MODE return opened(AT_FDCWD, path, flags, mode); }
int open64(const char *path, int flags, ...) { MODE return opened(AT_FDCWD, path, flags, mode); }
int openat(int folder, const char *path, int flags, ...) { MODE return opened(folder, path, flags, mode); }
int openat64(int folder, const char *path, int flags, ...) { MODE return opened(folder, path, flags, mode); }

static FILE *stream(FILE *(*real)(const char *, const char *), const char *path, const char *mode) {
    char full[PATH_MAX];
    struct stat found;
    int writes = mode[0] != 'r' || strchr(mode, '+'), what = 0, is_new = 0;
    int below = root_length && is_below(path);
    if (below) {
        what = fault(writes ? OPEN : READ);
        if (what == FAIL) return 0;
        is_new = writes && lstat(path, &found);
    }
    FILE *file = real(path, mode);
    if (file && below && writes && (is_new || mode[0] == 'w'))
        record(is_new ? "create" : "truncate", inode(fileno(file)), 0, absolute(path, full), "", 0, 0);
    after(what);
    return file;
}

FILE *fopen(const char *path, const char *mode) {
    REAL("fopen", FILE *, const char *, const char *);
    return stream(real, path, mode);
}
FILE *fopen64(const char *path, const char *mode) {
    REAL("fopen64", FILE *, const char *, const char *);
    return stream(real, path, mode);
}

static ssize_t written(int file, const void *bytes, size_t length, off_t place, int is_placed) {
    int below = file_is_below(file), what = below ? fault(WRITE) : 0;
    if (what == FAIL) return -1;
    if (what == SHORT && length > 1) length /= 2;
    if (below) pthread_mutex_lock(&order);
    ssize_t done = is_placed ? syscall(SYS_pwrite64, file, bytes, length, place)
                             : syscall(SYS_write, file, bytes, length);
    if (below && done > 0) {
        if (!is_placed) place = syscall(SYS_lseek, file, 0, SEEK_CUR) - done;
        record("write", inode(file), place, "", "", bytes, done);
    }
    if (below) pthread_mutex_unlock(&order);
    after(what);
    return done;
}

ssize_t write(int file, const void *bytes, size_t length) { return written(file, bytes, length, 0, 0); }
ssize_t pwrite(int file, const void *bytes, size_t length, off_t place) { return written(file, bytes, length, place, 1); }
ssize_t pwrite64(int file, const void *bytes, size_t length, off64_t place) { return written(file, bytes, length, place, 1); }

ssize_t writev(int file, const struct iovec *parts, int count) {
    if (!file_is_below(file)) return syscall(SYS_writev, file, parts, count);
    ssize_t all = 0;
    for (int i = 0; i < count; i++) {
        ssize_t done = parts[i].iov_len ? written(file, parts[i].iov_base, parts[i].iov_len, 0, 0) : 0;
        if (done < 0) return all ? all : -1;
        all += done;
        if ((size_t)done < parts[i].iov_len) break;
    }
    return all;
}

// Copies within the kernel are refused, so that libraries copy by writing.
ssize_t sendfile64(int to, int from, off64_t *place, size_t length) {
    if (file_is_below(to)) { errno = ENOSYS; return -1; }
    return syscall(SYS_sendfile, to, from, place, length);
}
ssize_t sendfile(int to, int from, off_t *place, size_t length) { return sendfile64(to, from, place, length); }
ssize_t copy_file_range(int from, off64_t *first, int to, off64_t *second, size_t length, unsigned flags) {
    if (file_is_below(to)) { errno = ENOSYS; return -1; }
    return syscall(SYS_copy_file_range, from, first, to, second, length, flags);
}

static int synchronised(int file, long call) {
    char path[PATH_MAX];
    int below = file_is_below(file), what = below ? fault(FSYNC) : 0;
    if (what == FAIL) return -1;
    if (below) pthread_mutex_lock(&order);
    int done = syscall(call, file);
    if (below && !done) record("fsync", inode(file), 0, path_of(file, 0, path), "", 0, 0);
    if (below) pthread_mutex_unlock(&order);
    after(what);
    return done;
}

int fsync(int file) { return synchronised(file, SYS_fsync); }
int fdatasync(int file) { return synchronised(file, SYS_fdatasync); }

static int resized(int file, off_t length) {
    int below = file_is_below(file), what = below ? fault(TRUNCATE) : 0;
    if (what == FAIL) return -1;
    if (below) pthread_mutex_lock(&order);
    int done = syscall(SYS_ftruncate, file, length);
    if (below && !done) record("truncate", inode(file), length, "", "", 0, 0);
    if (below) pthread_mutex_unlock(&order);
    after(what);
    return done;
}

int ftruncate(int file, off_t length) { return resized(file, length); }
int ftruncate64(int file, off64_t length) { return resized(file, length); }

static int reserved(int file, off_t place, off_t length) {
    if (file_is_below(file) && fault(TRUNCATE) == FAIL) return number;
    return syscall(SYS_fallocate, file, 0, place, length) ? errno : 0;
}
int posix_fallocate(int file, off_t place, off_t length) { return reserved(file, place, length); }
int posix_fallocate64(int file, off64_t place, off64_t length) { return reserved(file, place, length); }

int close(int file) {
    int what = file_is_below(file) ? fault(CLOSE) : 0;
    int done = syscall(SYS_close, file);  // The system closes it even where it says that it failed.
    if (what == FAIL) { errno = number; return -1; }
    after(what);
    return done;
}

static void *mapped(void *place, size_t length, int rights, int flags, int file, off_t offset) {
    int shares = flags & MAP_SHARED && rights & PROT_WRITE && file >= 0;
    if (shares && file_is_below(file) && fault(MMAP) == FAIL) return MAP_FAILED;
    return (void *)syscall(SYS_mmap, place, length, rights, flags, file, offset);
}
void *mmap(void *place, size_t length, int rights, int flags, int file, off_t offset) { return mapped(place, length, rights, flags, file, offset); }
void *mmap64(void *place, size_t length, int rights, int flags, int file, off64_t offset) { return mapped(place, length, rights, flags, file, offset); }

// An operation on a name below the folder, or on two.
static int named(const char *operation, int call, int folder, const char *name, int other_folder,
                 const char *other, long (*work)(int, const char *, int, const char *, int), int extra) {
    char one[PATH_MAX], two[PATH_MAX] = "";
    const char *from = root_length ? path_of(folder, name, one) : name;
    const char *to = other && root_length ? path_of(other_folder, other, two) : "";
    int below = root_length && (is_below(from) || is_below(to)), what = below ? fault(call) : 0;
    if (what == FAIL) return -1;
    if (below) pthread_mutex_lock(&order);
    int done = work(folder, name, other_folder, other, extra);
    if (below && !done) record(operation, 0, 0, from, to, 0, 0);
    if (below) pthread_mutex_unlock(&order);
    after(what);
    return done;
}

static long do_rename(int a, const char *from, int b, const char *to, int flags) { return syscall(SYS_renameat2, a, from, b, to, flags); }
static long do_link(int a, const char *from, int b, const char *to, int flags) { return syscall(SYS_linkat, a, from, b, to, flags); }
static long do_unlink(int a, const char *path, int b, const char *to, int flags) { return syscall(SYS_unlinkat, a, path, flags); }
static long do_mkdir(int a, const char *path, int b, const char *to, int mode) { return syscall(SYS_mkdirat, a, path, mode); }

int rename(const char *from, const char *to) { return named("rename", RENAME, AT_FDCWD, from, AT_FDCWD, to, do_rename, 0); }
int renameat(int a, const char *from, int b, const char *to) { return named("rename", RENAME, a, from, b, to, do_rename, 0); }
int renameat2(int a, const char *from, int b, const char *to, unsigned flags) { return named("rename", RENAME, a, from, b, to, do_rename, flags); }
int link(const char *from, const char *to) { return named("link", RENAME, AT_FDCWD, from, AT_FDCWD, to, do_link, 0); }
int linkat(int a, const char *from, int b, const char *to, int flags) { return named("link", RENAME, a, from, b, to, do_link, flags); }
int unlink(const char *path) { return named("unlink", UNLINK, AT_FDCWD, path, 0, 0, do_unlink, 0); }
int unlinkat(int a, const char *path, int flags) { return named(flags & AT_REMOVEDIR ? "rmdir" : "unlink", UNLINK, a, path, 0, 0, do_unlink, flags); }
int rmdir(const char *path) { return named("rmdir", UNLINK, AT_FDCWD, path, 0, 0, do_unlink, AT_REMOVEDIR); }
int mkdir(const char *path, mode_t mode) { return named("mkdir", MKDIR, AT_FDCWD, path, 0, 0, do_mkdir, mode); }
int mkdirat(int a, const char *path, mode_t mode) { return named("mkdir", MKDIR, a, path, 0, 0, do_mkdir, mode); }

static long offset_now(void) {
    if (!clock_offset) return 0;
    return __atomic_add_fetch(&clock_reads, 1, __ATOMIC_SEQ_CST) > clock_at ? clock_offset : 0;
}

int clock_gettime(clockid_t which, struct timespec *now) {
    int done = syscall(SYS_clock_gettime, which, now);
    if (which == CLOCK_REALTIME || which == CLOCK_REALTIME_COARSE) now->tv_sec += offset_now();
    return done;
}
int gettimeofday(struct timeval *now, void *zone) {
    int done = syscall(SYS_gettimeofday, now, zone);
    now->tv_sec += offset_now();
    return done;
}
time_t time(time_t *place) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (place) *place = now.tv_sec;
    return now.tv_sec;
}
