//! A connection: description, records, requests.

use std::ffi::{c_char, c_void};
use std::ptr;

use torqued_client::robot_state::{Answer, Description, Name, Request, SharedRecord, request};
use torqued_client::{Location, Record};

use crate::code::{Code, Failure, guard};
use crate::words::{deref, text, time};

/// A connection to a robot's daemon; it outlives the daemon.
pub struct Client {
    pub(crate) client: torqued_client::Client,
    /// The record that the caller reads.
    held: Option<Record>,
}

/// Connects to the daemon that runs `robot`, or to the only one that runs if `robot` is null, waiting at
/// most `timeout_s` for it. `client` is to be closed by `torqued_disconnect`.
///
/// # Safety
/// `robot` is null or a text; `client` points to room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_connect(
    robot: *const c_char,
    timeout_s: f64,
    client: *mut *mut Client,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let handle = unsafe { deref(client, "client") }?;
        *handle = ptr::null_mut();
        let timeout = time(timeout_s, "timeout_s")?;
        let location = Location::find()?;
        let robot = if robot.is_null() {
            location.only_robot()?
        } else {
            // SAFETY: the caller's promise.
            unsafe { text(robot, "robot") }?.to_owned()
        };
        let client = torqued_client::Client::connect_at(&location, &robot, timeout)?;
        *handle = Box::into_raw(Box::new(Client { client, held: None }));
        Ok(())
    })
}

/// Closes a connection and releases its record. Null is allowed. Its commander may live on.
///
/// # Safety
/// A handle that is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_disconnect(client: *mut Client) {
    if !client.is_null() {
        // SAFETY: from `Box::into_raw`, and given back once.
        let client = unsafe { Box::from_raw(client) };
        guard(|| {
            drop(client);
            Ok(())
        });
    }
}

/// Names and constants of the robot, valid as long as the connection; they change when another daemon
/// takes over. Null if `client` is.
///
/// # Safety
/// A handle, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_description(client: *const Client) -> *const Description {
    // SAFETY: the caller's promise.
    unsafe { client.as_ref() }.map_or(ptr::null(), |c| ptr::from_ref(c.client.description()))
}

/// The next record in order, waiting at most `timeout_s`. `record` points into shared memory and is valid
/// until the next call with this client. `lost`, if not null: records lost since the last call, because
/// this client was too slow.
///
/// # Safety
/// A handle; room for a pointer; room for a number, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_next_record(
    client: *mut Client,
    timeout_s: f64,
    record: *mut *const SharedRecord,
    lost: *mut u64,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let (client, room) = unsafe { (deref(client, "client")?, deref(record, "record")?) };
        *room = ptr::null();
        client.held = None;
        let timeout = time(timeout_s, "timeout_s")?;
        let record = client.client.next_record(timeout)?;
        // SAFETY: the caller's promise.
        unsafe { client.hold(record, room, lost) };
        Ok(())
    })
}

/// The newest record, or null if none has arrived since the last call; those before it are skipped and not
/// counted as lost. Else as `torqued_next_record`.
///
/// # Safety
/// As `torqued_next_record`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_latest_record(
    client: *mut Client,
    record: *mut *const SharedRecord,
    lost: *mut u64,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let (client, room) = unsafe { (deref(client, "client")?, deref(record, "record")?) };
        *room = ptr::null();
        client.held = None;
        match client.client.latest()? {
            // SAFETY: the caller's promise.
            Some(record) => unsafe { client.hold(record, room, lost) },
            // SAFETY: the caller's promise.
            None => unsafe { set(lost, 0) },
        }
        Ok(())
    })
}

impl Client {
    /// Keeps the record for the caller.
    unsafe fn hold(&mut self, record: Record, room: &mut *const SharedRecord, lost: *mut u64) {
        // SAFETY: the caller's promise.
        unsafe { set(lost, record.lost) };
        *room = ptr::from_ref::<SharedRecord>(self.held.insert(record));
    }
}

unsafe fn set(lost: *mut u64, number: u64) {
    // SAFETY: null, or room for a number: the caller's promise.
    if let Some(lost) = unsafe { lost.as_mut() } {
        *lost = number;
    }
}

/// Sends a request, all of its fields but `id` filled, and waits for its last answer. `progress`, if not
/// null, receives those before, each with `context`. `answer`: the last one, or null.
///
/// # Safety
/// A handle; a request; a function that returns; room for an answer, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_request(
    client: *const Client,
    request: *const Request,
    progress: Option<unsafe extern "C" fn(context: *mut c_void, answer: *const Answer)>,
    context: *mut c_void,
    answer: *mut Answer,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise; neither is written to.
        let client = unsafe { deref(client.cast_mut(), "client") }?;
        // SAFETY: as above.
        let request = *unsafe { deref(request.cast_mut(), "request") }?;
        let last = client.client.send_request(request, |working| {
            if let Some(progress) = progress {
                // SAFETY: the caller's function, with the caller's context.
                unsafe { progress(context, working) };
            }
        })?;
        // SAFETY: the caller's promise.
        if let Some(answer) = unsafe { answer.as_mut() } {
            *answer = last;
        }
        Ok(())
    })
}

unsafe fn simple(client: *const Client, kind: u32, fault: u32, contact_set: &str) -> Code {
    let asked = Request {
        kind,
        fault,
        contact_set: Name::new(contact_set),
        ..Request::default()
    };
    // SAFETY: the caller's promise.
    unsafe {
        torqued_request(
            client,
            &raw const asked,
            None,
            ptr::null_mut(),
            ptr::null_mut(),
        )
    }
}

/// Switches the drives on and waits until every joint is held where it stands.
///
/// # Safety
/// A handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_enable(client: *const Client) -> Code {
    // SAFETY: the caller's promise.
    unsafe { simple(client, request::ENABLE, 0, "") }
}

/// Ends all set-points and switches the drives off; waits until it is so.
///
/// # Safety
/// A handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_disable(client: *const Client) -> Code {
    // SAFETY: the caller's promise.
    unsafe { simple(client, request::DISABLE, 0, "") }
}

/// Brings the robot to rest and waits until it holds.
///
/// # Safety
/// A handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_stop(client: *const Client) -> Code {
    // SAFETY: the caller's promise.
    unsafe { simple(client, request::STOP, 0, "") }
}

/// Acknowledges the latched fault of that number, that of `TorquedCycleRecord::fault`.
///
/// # Safety
/// A handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_acknowledge(client: *const Client, fault: u32) -> Code {
    // SAFETY: the caller's promise.
    unsafe { simple(client, request::ACKNOWLEDGE, fault, "") }
}

/// Uses that contact set from now on, one of `TorquedDescription::contact_set_names`; null: the automatic
/// rule chooses it.
///
/// # Safety
/// A handle; a text, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_choose_contact_set(
    client: *const Client,
    name: *const c_char,
) -> Code {
    if name.is_null() {
        // SAFETY: the caller's promise.
        return unsafe { simple(client, request::AUTOMATIC_CONTACT_SET, 0, "") };
    }
    let mut set = "";
    let read = guard(|| {
        // SAFETY: the caller's promise.
        set = unsafe { text(name, "name") }?;
        if set.len() > size_of::<Name>() {
            let longest = size_of::<Name>();
            return Err(Failure::argument(format!(
                "name has {} bytes; allowed: {longest}",
                set.len()
            )));
        }
        Ok(())
    });
    match read {
        // SAFETY: the caller's promise.
        Code::Ok => unsafe { simple(client, request::CHOOSE_CONTACT_SET, 0, set) },
        code => code,
    }
}
