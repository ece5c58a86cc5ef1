//! An allocator that counts. Every program that links this crate has it: no test can forget it.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

thread_local! {
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    // A thread that ends has no counter any more.
    let _ = CALLS.try_with(|calls| calls.set(calls.get() + 1));
}

// SAFETY: every call is passed on to the system's allocator; counting allocates nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        count();
        // SAFETY: `memory` came from `alloc` above, hence from the system's allocator.
        unsafe { System.dealloc(memory, layout) }
    }
}

/// How often this thread has allocated or freed memory.
#[must_use]
pub fn allocations() -> u64 {
    CALLS.with(Cell::get)
}

#[cfg(test)]
mod tests {
    use super::allocations;

    #[test]
    fn counts_every_kind_of_call_in_this_thread() {
        let before = allocations();
        let mut numbers = std::hint::black_box(vec![0_u8; 8]);
        assert_eq!(allocations() - before, 1);
        numbers.reserve_exact(1000);
        // Growing: one call to allocate, one to free.
        assert_eq!(allocations() - before, 3);
        drop(numbers);
        assert_eq!(allocations() - before, 4);
    }

    #[test]
    #[expect(clippy::disallowed_methods, reason = "threads are what is tested")]
    fn another_thread_counts_for_itself() {
        let other = std::thread::spawn(|| {
            let before = allocations();
            drop(std::hint::black_box(Box::new(7)));
            allocations() - before
        });
        while !other.is_finished() {
            std::hint::spin_loop();
        }
        let before = allocations();
        std::hint::black_box(before + 1);
        assert_eq!(allocations(), before);
        assert_eq!(other.join().ok(), Some(2));
    }
}
