//! SIGBUS in the publisher thread: the thread is parked, and the process goes on.
//!
//! The kernel sends the signal to a thread that touches shared memory where no memory is left.
//! Memory is reserved when files are made, so this is the second line: a file that another process
//! has cut short, or made just now. The thread cannot go on, since its write cannot be undone or
//! repeated; without it no client is served, and the loop finds its heartbeat standing still.

use std::cell::Cell;
use std::ptr;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    /// Set in a publisher thread: its flag for having been parked.
    static PARKED: Cell<*const AtomicBool> = const { Cell::new(ptr::null()) };
}

/// Parks the calling thread at its first SIGBUS, and sets `parked` then.
pub(super) fn park_this_thread(parked: &'static AtomicBool) {
    PARKED.set(ptr::from_ref(parked));
    // SAFETY: a plain C struct, for which zero is a valid value: no flags, nothing blocked.
    let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
    action.sa_sigaction = on_bus_error as *const () as libc::sighandler_t;
    // SAFETY: the struct is alive during the call; the handler calls only functions that are safe
    // in handlers.
    unsafe {
        libc::sigaction(libc::SIGBUS, &raw const action, ptr::null_mut());
    }
}

extern "C" fn on_bus_error(_: libc::c_int) {
    let parked = PARKED.get();
    if parked.is_null() {
        // Not ours: the fault is repeated on return, and then ends the process.
        // SAFETY: takes no pointer, and is allowed in handlers.
        unsafe { libc::signal(libc::SIGBUS, libc::SIG_DFL) };
        return;
    }
    // SAFETY: from a `&'static`.
    unsafe { &*parked }.store(true, Ordering::Release);
    loop {
        // SAFETY: takes nothing, and is allowed in handlers.
        unsafe { libc::pause() };
    }
}
