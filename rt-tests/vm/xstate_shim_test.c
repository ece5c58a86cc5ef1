/* xstate_shim.c on a child process of this one, on whichever processor: a register set of full
 * length and a shorter one are both set, and what the shorter one lacks stays as it was.
 * Exit code 0 if so; else the failed check is printed.
 */
#define _GNU_SOURCE
#include <elf.h>
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#define TYPE ((void *)NT_X86_XSTATE)
/* Offsets in the XSAVE layout (Intel SDM 1, 13.4): XMM0, XSTATE_BV. */
#define XMM0 160
#define XSTATE_BV 512
#define XSAVE_HEADER_END 576
#define X87_AND_SSE 3

static char before[32768] __attribute__((aligned(64)));
static char after[32768] __attribute__((aligned(64)));
static pid_t child;

static void check(int holds, const char *what) {
  if (holds)
    return;
  printf("failed: %s (%s)\n", what, strerror(errno));
  kill(child, SIGKILL);
  exit(1);
}

static size_t get(char *state) {
  struct iovec all = {state, sizeof before};
  memset(state, 0, sizeof before);
  check(ptrace(PTRACE_GETREGSET, child, TYPE, &all) == 0, "registers are read");
  return all.iov_len;
}

/* Writes `mark` to XMM0, sets the first `length` bytes, and compares the whole set. */
static void sets(size_t length, char mark, const char *what) {
  size_t full = get(before);
  memset(before + XMM0, mark, 16);
  before[XSTATE_BV] |= X87_AND_SSE;
  struct iovec given = {before, length};
  check(ptrace(PTRACE_SETREGSET, child, TYPE, &given) == 0, what);
  check(get(after) == full, "the length stays");
  check(memcmp(before + XMM0, after + XMM0, 16) == 0, "the given registers are set");
  check(memcmp(before + XSAVE_HEADER_END, after + XSAVE_HEADER_END, full - XSAVE_HEADER_END) == 0,
        "all other registers stay");
}

int main(void) {
  child = fork();
  if (child == 0) {
    ptrace(PTRACE_TRACEME, 0, 0, 0);
    raise(SIGSTOP);
    _exit(0);
  }
  int status;
  check(waitpid(child, &status, 0) == child && WIFSTOPPED(status), "the child stops");
  size_t full = get(before);
  check(full > XSAVE_HEADER_END + 64, "the processor has more state than SSE's");

  sets(full, 0x5a, "a set of full length is taken");
  sets(full - 64, 0x3c, "a shorter set is taken");
  sets(XSAVE_HEADER_END, 0x77, "a set of the legacy area and the header alone is taken");

  /* The case for which the shim is there: without it the kernel refuses the shorter set. */
  struct iovec shorter = {before, full - 64};
  long refused = syscall(SYS_ptrace, PTRACE_SETREGSET, child, TYPE, &shorter);
  printf("full set %zu bytes; without the shim a shorter one is %s\n", full,
         refused == 0 ? "taken" : "refused");
  kill(child, SIGKILL);
  return 0;
}
