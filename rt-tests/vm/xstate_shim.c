/* Lets User-Mode Linux 6.1 run on processors whose extended register state is larger than the
 * buffer it keeps for it (2,696 bytes), such as those with AMX.
 *
 * User-Mode Linux switches its processes' registers by ptrace. The host's kernel accepts a
 * register set of its own full length only: PTRACE_SETREGSET of NT_X86_XSTATE with a shorter one
 * fails with EFAULT, and User-Mode Linux panics at its first process (put_fp_registers). Loaded
 * by LD_PRELOAD, this ptrace reads the full set, lays the given bytes over its start, and sets
 * the result. Where the lengths agree it passes everything on as it is.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/uio.h>

/* Larger than any state that processors define today (AMX: 11,008 bytes). */
#define LARGEST_STATE 32768

typedef long (*ptrace_function)(int request, int pid, void *address, void *data);

static long set_extended_state(ptrace_function next, int pid, void *type, struct iovec *given) {
  static char state[LARGEST_STATE] __attribute__((aligned(64)));
  struct iovec full = {state, sizeof state};
  if (next(PTRACE_GETREGSET, pid, type, &full) != 0 || full.iov_len <= given->iov_len)
    return next(PTRACE_SETREGSET, pid, type, given);
  memcpy(state, given->iov_base, given->iov_len);
  return next(PTRACE_SETREGSET, pid, type, &full);
}

long ptrace(enum __ptrace_request request, ...) {
  static ptrace_function next;
  if (!next)
    next = (ptrace_function)dlsym(RTLD_NEXT, "ptrace");
  if (!next) {
    errno = ENOSYS;
    return -1;
  }
  va_list arguments;
  va_start(arguments, request);
  int pid = va_arg(arguments, int);
  void *address = va_arg(arguments, void *);
  void *data = va_arg(arguments, void *);
  va_end(arguments);
  if (request == PTRACE_SETREGSET && address == (void *)NT_X86_XSTATE && data)
    return set_extended_state(next, pid, address, data);
  return next((int)request, pid, address, data);
}
