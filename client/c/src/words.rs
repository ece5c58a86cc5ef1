//! Words for numbers in records, and arguments from C.

use std::ffi::{CStr, c_char};
use std::time::Duration;

use torqued_client::robot_state::{Event, Mode, RobotState};

use crate::code::Failure;

/// The text behind a pointer.
///
/// # Safety
/// Null, or a text that ends with a zero byte.
pub(crate) unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Result<&'a str, Failure> {
    if pointer.is_null() {
        return Err(Failure::argument(format!("{name} is a null pointer")));
    }
    // SAFETY: the caller's promise.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str()
        .map_err(|_| Failure::argument(format!("{name} is not UTF-8")))
}

/// What a pointer to a handle or a record refers to.
///
/// # Safety
/// Null, or a pointer that nothing else uses while the reference lives.
pub(crate) unsafe fn deref<'a, T>(pointer: *mut T, name: &str) -> Result<&'a mut T, Failure> {
    // SAFETY: the caller's promise.
    let target = unsafe { pointer.as_mut() };
    target.ok_or_else(|| Failure::argument(format!("{name} is a null pointer")))
}

pub(crate) fn time(seconds: f64, name: &str) -> Result<Duration, Failure> {
    Duration::try_from_secs_f64(seconds).map_err(|_| {
        Failure::argument(format!(
            "{name} is {seconds} s; allowed: a finite time of 0 or more"
        ))
    })
}

/// Name of a `TorquedMode`, e.g. `inverse_dynamics`; null for another number.
#[unsafe(no_mangle)]
pub extern "C" fn torqued_mode_name(mode: u32) -> *const c_char {
    let name = Mode::from_number(mode).map(Mode::c_name);
    name.map_or(std::ptr::null(), CStr::as_ptr)
}

/// Name of a `TorquedRobotState`, e.g. `holding`; null for another number.
#[unsafe(no_mangle)]
pub extern "C" fn torqued_state_name(state: u32) -> *const c_char {
    let name = match RobotState::from_number(state) {
        None => return std::ptr::null(),
        Some(RobotState::Boot) => c"boot",
        Some(RobotState::Ready) => c"ready",
        Some(RobotState::Enabling) => c"enabling",
        Some(RobotState::Holding) => c"holding",
        Some(RobotState::Active) => c"active",
        Some(RobotState::Stopping) => c"stopping",
        Some(RobotState::Fault) => c"fault",
    };
    name.as_ptr()
}

/// Number of the event whose count is `TorquedCycleRecord::events[index]`, e.g. 404; 0 beyond the last.
#[unsafe(no_mangle)]
pub extern "C" fn torqued_event_number(index: usize) -> u32 {
    Event::ALL.get(index).map_or(0, |event| event.number())
}

/// Writes an event's name, cause and config key as one line of UTF-8, cut to `size` bytes with the zero at
/// its end. `number`: as in `TorquedCycleRecord::fault`. Returns the line's length without the zero; 0
/// if there is no such event.
///
/// # Safety
/// `words` has room for `size` bytes, or is null with `size` 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_event_words(
    number: u32,
    words: *mut c_char,
    size: usize,
) -> usize {
    let line = Event::from_number(number).map_or_else(String::new, |event| {
        let (name, cause, key) = (event.name(), event.cause(), event.config_key());
        format!("{number} {name}: {cause} (config key {key})")
    });
    if !words.is_null() && size > 0 {
        let mut end = line.len().min(size - 1);
        while !line.is_char_boundary(end) {
            end -= 1;
        }
        // SAFETY: `end + 1` bytes fit into `size`; a text does not overlap with the caller's room.
        unsafe {
            std::ptr::copy_nonoverlapping(line.as_ptr(), words.cast(), end);
            *words.add(end) = 0;
        }
    }
    line.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_the_records() {
        for mode in Mode::ALL {
            // SAFETY: a constant text.
            let name = unsafe { CStr::from_ptr(torqued_mode_name(mode.number())) };
            assert_eq!(name.to_str(), Ok(mode.name()));
        }
        for state in RobotState::ALL {
            // SAFETY: a constant text.
            let name = unsafe { CStr::from_ptr(torqued_state_name(state.number())) };
            assert_eq!(name.to_str(), Ok(state.name()));
        }
        assert!(torqued_mode_name(99).is_null() && torqued_state_name(99).is_null());
    }

    #[test]
    fn an_events_words_are_cut_to_the_room() {
        let mut room = [1 as c_char; 8];
        // SAFETY: the room's own size.
        let length = unsafe { torqued_event_words(404, room.as_mut_ptr(), room.len()) };
        // SAFETY: a zero was written.
        let cut = unsafe { CStr::from_ptr(room.as_ptr()) };
        assert_eq!((cut.to_str(), length > 20), (Ok("404 ena"), true));
        // SAFETY: no room at all.
        let unknown = unsafe { torqued_event_words(1, std::ptr::null_mut(), 0) };
        assert_eq!(unknown, 0);
        assert_eq!(torqued_event_number(usize::MAX), 0);
    }
}
