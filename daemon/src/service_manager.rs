//! Notifications to systemd (`Type=notify`): ready, the robot's state, and a sign of life that is
//! the loop's own.
//!
//! READY=1 follows the first cycle, robot switched on or not. WATCHDOG=1 is sent only while the
//! loop's count of cycles advances: a loop that hangs is ended and restarted by systemd after
//! `WatchdogSec=`. Outside of systemd nothing is sent.

use std::time::{Duration, Instant};

use sd_notify::NotifyState;

/// Signs of life within the time that systemd allows.
const SIGNS: u32 = 4;

type Send = Box<dyn FnMut(&[NotifyState<'_>])>;

/// The connection to systemd.
pub struct ServiceManager {
    send: Send,
    /// Interval between two signs of life; none: systemd expects none.
    interval: Option<Duration>,
    /// Time and count of cycles of the last sign.
    sent: Instant,
    cycles: u64,
    status: String,
}

impl ServiceManager {
    /// The connection to the systemd that started this process, if any.
    #[must_use]
    pub fn find() -> Self {
        // Nobody may be listening: then there is nobody to notify.
        let send = |state: &[NotifyState<'_>]| drop(sd_notify::notify(state));
        Self::new(Box::new(send), sd_notify::watchdog_enabled())
    }

    /// A connection that passes messages to `send` and expects signs of life within `timeout`.
    #[must_use]
    pub fn new(send: Send, timeout: Option<Duration>) -> Self {
        Self {
            send,
            interval: timeout.map(|timeout| timeout / SIGNS),
            sent: Instant::now(),
            cycles: 0,
            status: String::new(),
        }
    }

    /// Sends the changes since the last call; `cycles`: count of the loop's cycles.
    pub fn update(&mut self, cycles: u64, status: &str, now: Instant) {
        if cycles == self.cycles {
            return;
        }
        let first = self.cycles == 0;
        if first {
            (self.send)(&[NotifyState::Ready]);
        }
        if self.status != status {
            status.clone_into(&mut self.status);
            (self.send)(&[NotifyState::Status(status)]);
        }
        let due = |interval| first || now.saturating_duration_since(self.sent) >= interval;
        if self.interval.is_some_and(due) {
            (self.send)(&[NotifyState::Watchdog]);
            self.sent = now;
        }
        self.cycles = cycles;
    }

    /// Notifies systemd that the controlled end has begun.
    pub fn stopping(&mut self) {
        (self.send)(&[NotifyState::Stopping]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::rc::Rc;

    #[test]
    fn signs_of_life_are_the_loops() {
        let messages = Rc::new(RefCell::new(Vec::new()));
        let copy = Rc::clone(&messages);
        let send = move |state: &[NotifyState<'_>]| {
            copy.borrow_mut()
                .extend(state.iter().map(ToString::to_string));
        };
        let taken = || std::mem::take(&mut *messages.borrow_mut());
        let ms = Duration::from_millis;
        let mut manager = ServiceManager::new(Box::new(send), Some(ms(400)));
        let start = Instant::now();
        manager.update(0, "boot", start);
        assert!(taken().is_empty(), "no cycle yet");
        manager.update(20, "boot", start + ms(20));
        assert_eq!(taken(), ["READY=1", "STATUS=boot", "WATCHDOG=1"]);
        manager.update(40, "boot", start + ms(40));
        assert!(taken().is_empty(), "too early");
        manager.update(200, "holding", start + ms(200));
        assert_eq!(taken(), ["STATUS=holding", "WATCHDOG=1"]);
        // The loop hangs.
        for time in (220..2000).step_by(20) {
            manager.update(200, "holding", start + ms(time));
        }
        assert!(taken().is_empty());
        manager.stopping();
        assert_eq!(taken(), ["STOPPING=1"]);
    }
}
