//! The measures themselves, one function each.

use super::{Denial, Measure};
use nix::errno::Errno;
use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
use nix::sys::mman::{MlockAllFlags, mlockall};
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
use nix::unistd::Pid;
use std::fs::{File, OpenOptions};
use std::io::Write;
use thread_priority::{
    NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue,
    ThreadSchedulePolicy,
};

/// Bytes of stack the loop may need; its frames are small, so this is ample.
const STACK: usize = 256 * 1024;
const PAGE: usize = 4096;
/// Number of the capability in the kernel's `capability.h`.
const CAP_IPC_LOCK: u32 = 14;

fn measure(name: String, essential: bool, outcome: Result<(), (String, String)>) -> Measure {
    Measure {
        name,
        essential,
        outcome: outcome.map_err(|(why, mend)| Denial { why, mend }),
    }
}

pub(super) fn pin_to_cpu(cpu: usize) -> Measure {
    let pin = || {
        let mut set = CpuSet::new();
        set.set(cpu)?;
        // 0 is the calling thread.
        sched_setaffinity(Pid::from_raw(0), &set)
    };
    let outcome = pin().map_err(|errno| {
        let online = std::fs::read_to_string("/sys/devices/system/cpu/online");
        let online = online.map_or_else(
            |_| "listed by lscpu".to_owned(),
            |text| format!("online: {}", text.trim()),
        );
        (
            format!("sched_setaffinity: {errno}"),
            format!(
                "set loop.cpu to a CPU that exists ({online}) and that the unit's AllowedCPUs= or \
                 CPUAffinity= lets the process use"
            ),
        )
    });
    measure(format!("CPU {cpu} only"), true, outcome)
}

/// Takes `cpu` from the calling thread, and so from every thread that it starts from now on, unless
/// it has no other.
pub(crate) fn keep_off_cpu(cpu: usize) -> nix::Result<()> {
    let this_thread = Pid::from_raw(0);
    let mut set = sched_getaffinity(this_thread)?;
    set.unset(cpu)?;
    let others = (0..CpuSet::count()).any(|other| set.is_set(other) == Ok(true));
    if others {
        sched_setaffinity(this_thread, &set)?;
    }
    Ok(())
}

pub(super) fn lock_memory() -> Measure {
    let mend = "systemd unit: LimitMEMLOCK=infinity; or /etc/security/limits.d/torqued.conf: \
                `USER - memlock unlimited`, then log in again; or \
                `setcap cap_sys_nice,cap_ipc_lock+ep` on the program";
    // With MCL_FUTURE under a finite limit the call can succeed and a later mmap fail: worse
    // than memory that is not locked.
    let outcome = match getrlimit(Resource::RLIMIT_MEMLOCK) {
        Ok((soft, _)) if soft != RLIM_INFINITY && !has_capability(CAP_IPC_LOCK) => Err((
            format!("RLIMIT_MEMLOCK is {soft} bytes and CAP_IPC_LOCK is missing"),
            mend.to_owned(),
        )),
        _ => mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE)
            .map_err(|errno| (format!("mlockall: {errno}"), mend.to_owned())),
    };
    measure("memory locked".to_owned(), true, outcome)
}

/// True if the process has the capability in effect; false where /proc does not show it.
fn has_capability(number: u32) -> bool {
    std::fs::read_to_string("/proc/self/status").is_ok_and(|status| {
        effective_capabilities(&status).is_some_and(|set| set >> number & 1 == 1)
    })
}

fn effective_capabilities(status: &str) -> Option<u64> {
    let hex = status
        .lines()
        .find_map(|line| line.strip_prefix("CapEff:"))?;
    u64::from_str_radix(hex.trim(), 16).ok()
}

/// Writes to every page of the stack the loop may need, so that none faults later.
#[inline(never)]
pub(super) fn prefault_stack() {
    let mut stack = [0_u8; STACK];
    for page in stack.chunks_mut(PAGE) {
        page[0] = 1;
    }
    std::hint::black_box(&mut stack);
}

/// Keeps the file open: the kernel then avoids idle states that take long to leave.
pub(super) fn hold_cpus_awake() -> (Measure, Option<File>) {
    const PATH: &str = "/dev/cpu_dma_latency";
    let open = || -> std::io::Result<File> {
        let mut file = OpenOptions::new().write(true).open(PATH)?;
        // The latency the loop bears, µs.
        file.write_all(&0_i32.to_ne_bytes())?;
        Ok(file)
    };
    let (outcome, file) = match open() {
        Ok(file) => (Ok(()), Some(file)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => (
            Err((
                format!("{PATH} does not exist"),
                "nothing to do on a virtual machine; otherwise a kernel with CONFIG_CPU_IDLE"
                    .to_owned(),
            )),
            None,
        ),
        Err(error) => (
            Err((
                format!("{PATH}: {error}"),
                format!(
                    "udev rule: KERNEL==\"cpu_dma_latency\", GROUP=\"realtime\", MODE=\"0660\" \
                     with the user in that group; systemd unit: DeviceAllow={PATH} rw"
                ),
            )),
            None,
        ),
    };
    (measure("CPUs kept awake".to_owned(), false, outcome), file)
}

pub(super) fn schedule_fifo(priority: u8) -> Measure {
    let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let outcome = ThreadPriorityValue::try_from(priority)
        .map_err(|_| thread_priority::Error::PriorityNotInRange(1..=99))
        .and_then(|value| {
            thread_priority::set_thread_priority_and_policy(
                thread_priority::thread_native_id(),
                ThreadPriority::Crossplatform(value),
                fifo,
            )
        })
        .map_err(|error| fifo_denial(priority, &error));
    measure(format!("scheduler SCHED_FIFO {priority}"), true, outcome)
}

/// The library's priority, of 0 to 99, that is a nice value of 0: that of any program.
const NICE_0: u8 = 47;
/// That of a nice value of -10: nine tenths of a CPU beside any other program.
const NICE_MINUS_10: u8 = 73;

/// Leaves the real-time scheduler that the thread may have inherited.
pub(crate) fn run_as_ordinary_thread() {
    // Without the right to a smaller nice value than the process has, the thread keeps that.
    let _ = run_at(NICE_0);
}

/// Leaves the real-time scheduler, but comes before ordinary programs where the process may. Clients'
/// references pass through such a thread: with a nice value of 19 they were late on a busy machine by
/// a tenth of a second.
pub(crate) fn run_before_ordinary_threads() {
    if run_at(NICE_MINUS_10).is_err() {
        run_as_ordinary_thread();
    }
}

fn run_at(priority: u8) -> Result<(), thread_priority::Error> {
    let ordinary = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
    let priority = ThreadPriorityValue::try_from(priority)
        .map_err(|_| thread_priority::Error::PriorityNotInRange(0..=99))?;
    thread_priority::set_thread_priority_and_policy(
        thread_priority::thread_native_id(),
        ThreadPriority::Crossplatform(priority),
        ordinary,
    )
}

fn fifo_denial(priority: u8, error: &thread_priority::Error) -> (String, String) {
    match error {
        thread_priority::Error::OS(number) => (
            format!("pthread_setschedparam: {}", Errno::from_raw(*number)),
            format!(
                "systemd unit: LimitRTPRIO={priority}; or /etc/security/limits.d/torqued.conf: \
                 `USER - rtprio {priority}`, then log in again; or \
                 `setcap cap_sys_nice,cap_ipc_lock+ep` on the program"
            ),
        ),
        other => (
            other.to_string(),
            "loop.priority: allowed: 1 to 99".to_owned(),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cpus() -> Vec<usize> {
        let set = sched_getaffinity(Pid::from_raw(0)).unwrap();
        let usable = |cpu: &usize| set.is_set(*cpu).unwrap();
        (0..CpuSet::count()).filter(usable).collect()
    }

    #[test]
    fn threads_that_serve_the_loop_keep_off_its_cpu_while_they_have_another() {
        let tried = std::thread::spawn(|| {
            for cpu in cpus() {
                let before = cpus();
                keep_off_cpu(cpu).unwrap();
                let inherited = std::thread::spawn(cpus).join().unwrap();
                if before.len() > 1 {
                    assert!(!inherited.contains(&cpu));
                    assert_eq!(inherited.len(), before.len() - 1);
                } else {
                    assert_eq!(inherited, before);
                }
            }
        });
        tried.join().unwrap();
    }

    #[test]
    fn capabilities_are_read_from_the_status_text() {
        let status = "Name:\ttorqued\nCapPrm:\t0000000000000000\nCapEff:\t0000000000004000\n";
        let set = effective_capabilities(status).unwrap();
        assert_eq!(set >> CAP_IPC_LOCK & 1, 1);
        assert_eq!(set & !(1 << CAP_IPC_LOCK), 0);
        assert_eq!(effective_capabilities("Name:\ttorqued\n"), None);
    }

    #[test]
    fn a_priority_out_of_range_is_answered_with_the_range() {
        for priority in [0, 100, 255] {
            let denied = schedule_fifo(priority).outcome.unwrap_err();
            assert!(denied.mend.contains("1 to 99"), "{denied:?}");
        }
    }

    /// Nice value of the calling thread.
    fn nice() -> i32 {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
        // The name may contain spaces.
        let (_, after_name) = stat.rsplit_once(')').unwrap();
        after_name
            .split_whitespace()
            .nth(16)
            .unwrap()
            .parse()
            .unwrap()
    }

    #[test]
    fn an_ordinary_thread_is_no_nicer_than_its_program() {
        let own = nice();
        let ordinary = std::thread::spawn(|| {
            run_as_ordinary_thread();
            nice()
        });
        let ordinary = ordinary.join().unwrap();
        assert!(ordinary == 0 || ordinary == own, "{ordinary} {own}");
    }

    #[test]
    fn a_thread_that_serves_clients_comes_before_ordinary_programs_where_it_may() {
        let own = nice();
        let urgent = std::thread::spawn(|| {
            run_before_ordinary_threads();
            nice()
        });
        let urgent = urgent.join().unwrap();
        assert!([-10, 0, own].contains(&urgent), "{urgent} {own}");
        let may = std::fs::read_to_string("/proc/self/status").is_ok_and(|status| {
            effective_capabilities(&status).is_some_and(|set| set >> 23 & 1 == 1)
        });
        assert!(!may || urgent == -10, "{urgent}");
    }

    #[test]
    fn a_refused_scheduler_names_each_way_to_permit_it() {
        let error = thread_priority::Error::OS(Errno::EPERM as i32);
        let (why, mend) = fifo_denial(80, &error);
        assert!(why.contains("EPERM"), "{why}");
        for key in ["LimitRTPRIO=80", "rtprio 80", "cap_sys_nice"] {
            assert!(mend.contains(key), "{mend}");
        }
    }

    #[test]
    fn a_cpu_that_does_not_exist_is_answered_with_those_that_do() {
        let denied = pin_to_cpu(1_000).outcome.unwrap_err();
        assert!(denied.mend.contains("loop.cpu"), "{denied:?}");
        // More than the set can hold.
        assert!(pin_to_cpu(usize::MAX).outcome.is_err());
    }
}
