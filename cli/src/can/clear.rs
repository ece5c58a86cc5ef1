//! `torquectl can clear`: the error of a drive that is off.

use super::{Done, Line, OneNode, Target, scanned};
use drives::canopen::Object;
use drives::canopen::sdo::{Progress, Request, SdoError, Transfer};
use drives::cia402::CONTROL_WORD;
use drives::family::{Address, translation};
use drives::scan::Found;
use serde_json::json;
use torqued::failure::Failure;

/// Longest wait for an answer by SDO, ns.
const ANSWER_NS: u64 = 500_000_000;
/// Time that a drive gets to clear its error, ns.
const SETTLE_NS: u64 = 300_000_000;

pub(super) fn run(one: &OneNode) -> Done {
    let target = Target::of(&one.at)?;
    let mut line = Line::open(&target.buses)?;
    let (before, _) = scanned(&mut line, &target.buses, Some(one.node));
    let node = one.node;
    let [device] = &before[..] else {
        let what = if before.is_empty() {
            format!("nobody answers as {node}")
        } else {
            format!(
                "{} devices answer as {node}; name one bus by --bus",
                before.len()
            )
        };
        return Err(Failure::environment(what));
    };
    let family = device.family;
    if device.is_on == Some(true) {
        let what = format!(
            "{family} {node} is on ({}): nothing is sent",
            device.state.unwrap_or("-")
        );
        return Err(Failure::environment(what));
    }
    clear(&mut line, device)?;
    let (after, _) = scanned(&mut line, &target.buses, Some(node));
    let is_there = !after.is_empty();
    let left = after.iter().find_map(|found| found.error.clone());
    let fault = after.iter().any(|found| found.state == Some("fault"));
    let done = is_there && left.is_none() && !fault;
    let text = if one.at.json {
        let [before, after] = [&before, &after].map(|all| {
            let all: Vec<_> = all.iter().map(|found| target.json(found)).collect();
            json!(all)
        });
        format!(
            "{:#}\n",
            json!({ "before": before, "after": after, "cleared": done })
        )
    } else {
        let was = device
            .error
            .as_deref()
            .or(device.state)
            .unwrap_or("not reported");
        let is = match (&left, fault) {
            _ if !is_there => "nobody answers any more".to_owned(),
            (Some(error), _) => format!("still there: {error}"),
            (None, true) => "still in its fault: mend its cause".to_owned(),
            (None, false) => "no error".to_owned(),
        };
        format!("{family} {node}: was {was}; now {is}\n")
    };
    Ok((text, done))
}

fn clear(line: &mut Line, device: &Found) -> Result<(), Failure> {
    let at = (device.bus, device.node);
    match device.family {
        "canopen" => Err(Failure::environment(format!(
            "node {} is no drive of CiA 402: its error is not cleared",
            device.node
        ))),
        "cia402" if device.state != Some("fault") => Ok(()),
        // An edge of "fault reset"; with neither word a drive is enabled.
        "cia402" => [0x0000u16, 0x0080, 0x0000]
            .into_iter()
            .try_for_each(|word| write(line, at, CONTROL_WORD, word)),
        family => {
            let family = translation::named(family)
                .ok_or_else(|| Failure::environment(format!("no family {family}")))?;
            let frame = family.clear(Address {
                bus: device.bus,
                node: device.node,
                master: device
                    .reply
                    .unwrap_or_else(|| family.usual_reply(device.node)),
            });
            let mut until = None;
            line.run(|_, now, out| {
                if until.is_none() {
                    out.push(frame);
                }
                now >= *until.get_or_insert(now + SETTLE_NS)
            });
            Ok(())
        }
    }
}

/// Writes an object of 16 bits.
fn write(line: &mut Line, (bus, node): (u8, u8), object: Object, word: u16) -> Result<(), Failure> {
    let request = Request::Write(object, word.to_le_bytes().to_vec());
    let (mut transfer, first) = Transfer::start(bus, node, request);
    let mut first = Some(first);
    let mut until = None;
    let mut result = Err(SdoError::TimeOut);
    line.run(|frames, now, out| {
        out.extend(first.take());
        for frame in frames {
            if let Progress::Done(done, _) = transfer.receive(frame) {
                result = done;
                return true;
            }
        }
        now >= *until.get_or_insert(now + ANSWER_NS)
    });
    let failed = |error| Failure::environment(format!("node {node}, object {object}: {error}"));
    result.map(|_| ()).map_err(failed)
}
