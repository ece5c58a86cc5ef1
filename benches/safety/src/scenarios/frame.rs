//! Faults in the requests of clients of mode Cartesian.

use robot_state::{FrameReference, Mode};

use super::{CARTESIAN, HOLD, Place, Scenario, UNLED, at, client};
use crate::rig::{At, Fault};

const GROUP: &str = "Frames of mode Cartesian";

/// The first frame's reference is another one from the first cycle on.
fn frame(change: fn(&mut FrameReference)) -> Fault {
    client(move |rig, _| change(&mut rig.client.reference.frames[0]))
}

/// A client asks for mode Cartesian once the frame is shown, its first reference changed.
fn enter(change: fn(&mut FrameReference)) -> Fault {
    client(move |rig, k| match k {
        0 if !rig.client.speaks => rig.follow(Mode::Hold),
        0..5 => rig.client.reference.frames[0] = rig.frame(),
        5 => {
            rig.follow(Mode::Cartesian);
            change(&mut rig.client.reference.frames[0]);
        }
        _ => {}
    })
}

/// Every other message is the one before the last.
fn reordered(_: Place) -> Fault {
    let mut last = None;
    at(At::Client, move |rig, k| {
        let now = rig.client.reference;
        if k % 2 == 1 {
            rig.client.reference = last.unwrap_or(now);
        }
        last = Some(now);
    })
}

type Make = fn(Place) -> Fault;

pub(super) fn scenarios() -> Vec<Scenario> {
    let new = |name, starts, make| Scenario::new(GROUP, name, starts, make).of_led_frames();
    let entering: [(&str, Make); 4] = [
        ("change to Cartesian", |_| enter(|_| {})),
        ("the same, pose not a number", |_| {
            enter(|f| f.position[1] = f64::NAN)
        }),
        ("the same, pose 0.1 m away", |_| {
            enter(|f| f.position[0] += 0.1)
        }),
        ("the same, half a turn away", |_| {
            enter(|f| f.orientation = [0.0, 1.0, 0.0, 0.0])
        }),
    ];
    let forces: [(&str, Make); 4] = [
        ("the same, force at once", |_| {
            enter(|f| (f.stiffness, f.force[2]) = ([0.0; 6], 100.0))
        }),
        ("the same, force at once to the side", |_| {
            enter(|f| (f.stiffness, f.force[1]) = ([0.0; 6], -60.0))
        }),
        ("the same, force of 250 N at once, fed back", |_| {
            enter(|f| {
                (f.stiffness, f.force[2], f.force_axes) = ([0.0; 6], 250.0, 0b111);
            })
        }),
        ("the same, torque at once, springs beside it", |_| {
            enter(|f| {
                f.stiffness[4] = 0.0;
                f.force[4] = 10.0;
            })
        }),
    ];
    let changes: [(&str, Make); 16] = [
        ("pose not a number", |_| frame(|f| f.position[0] = f64::NAN)),
        ("pose infinite", |_| {
            frame(|f| f.position[2] = f64::NEG_INFINITY)
        }),
        ("pose 1e300 m away", |_| frame(|f| f.position[2] = 1e300)),
        ("orientation zero", |_| frame(|f| f.orientation = [0.0; 4])),
        ("orientation not a number", |_| {
            frame(|f| f.orientation[3] = f64::NAN)
        }),
        ("stiffness 1e9 N/m", |_| frame(|f| f.stiffness[0] = 1e9)),
        ("stiffness negative", |_| frame(|f| f.stiffness[4] = -10.0)),
        ("stiffness not a number", |_| {
            frame(|f| f.stiffness[2] = f64::NAN)
        }),
        ("damping ratio zero", |_| frame(|f| f.damping_ratio = 0.0)),
        ("force 1e6 N", |_| frame(|f| f.force[1] = 1e6)),
        ("force infinite", |_| frame(|f| f.force[5] = f64::INFINITY)),
        ("velocity 100 m/s", |_| frame(|f| f.velocity[0] = 100.0)),
        ("frame no longer used", |_| frame(|f| f.used = 0)),
        ("axes change to the frame's own", |_| {
            frame(|f| f.own_axes = 1)
        }),
        ("force fed back on stiff axes", |_| {
            frame(|f| (f.force_axes, f.stiffness) = (0b11_1111, [100.0; 6]))
        }),
        ("frames in the wrong order", reordered),
    ];
    let mut all = vec![
        new("change to Cartesian from another mode", UNLED, |_| {
            enter(|_| {})
        })
        .step(),
    ];
    all.extend(entering.map(|(name, make)| new(name, HOLD, make).step()));
    all.extend(forces.map(|(name, make)| new(name, HOLD, make).approach()));
    all.extend(changes.map(|(name, make)| new(name, CARTESIAN, make).step()));
    all
}
