//! Clients and operators: silence, changes of mode, references of every wrong kind, storms.

use cycle::OperatorRequest;
use robot_state::{Mode, Reference, Settings};

use super::{
    AT_REST, ENABLED, FOLLOWING, FOLLOWING_PRESSING, HOLD, MODES, Place, Scenario, Start, client,
    noise,
};
use crate::rig::{Fault, Rig};

const GROUP: &str = "Clients and operators";

/// The reference is another one from the first cycle on.
fn reference(change: impl Fn(&mut Reference, usize) + 'static) -> Fault {
    client(move |rig, k| change(&mut rig.client.reference, k))
}

/// One field of the joint's desired values.
fn field(place: Place, change: fn(&mut robot_state::JointReference)) -> Fault {
    reference(move |reference, _| change(&mut reference.joints[place.joint]))
}

/// From hold, or from another mode.
fn change_to(mode: Mode) -> Fault {
    client(move |rig, k| {
        if k == 0 {
            rig.follow(mode);
        }
    })
}

fn killed(_: Place) -> Fault {
    client(|rig, _| rig.client.speaks = false)
}

/// The client is gone, the last reference gets older.
fn silent(_: Place) -> Fault {
    let mut kept = None;
    client(move |rig, k| {
        let last = *kept.get_or_insert(rig.client.reference);
        rig.client.reference = last;
        rig.client.age_s = 1e-3 * (k + 1) as f64;
    })
}

fn reordered(_: Place) -> Fault {
    let mut last = Reference::default();
    client(move |rig, k| {
        let now = rig.client.reference;
        if k % 2 == 1 {
            rig.client.reference = last;
        }
        last = now;
    })
}

fn back_and_forth(place: Place) -> Fault {
    client(move |rig, k| {
        let modes = [place.start.mode(), Mode::Hold];
        rig.client.reference.mode = modes[k / 20 % 2].number();
    })
}

fn requests(any: fn(usize, &Rig) -> Option<OperatorRequest>) -> Fault {
    client(move |rig, k| rig.client.request = any(k, rig))
}

fn settings(change: fn(&mut Settings, usize, f64)) -> Fault {
    let mut random = noise(19);
    client(move |rig, k| {
        let mut settings = Settings {
            sequence: k as u64 + 1,
            ..Settings::default()
        };
        change(&mut settings, k, random());
        rig.client.settings = Some(settings);
    })
}

/// A client that has lost the robot goes on, then asks for hold and for its mode again.
fn comes_back(place: Place) -> Fault {
    client(move |rig, k| {
        rig.client.speaks = k >= 200;
        match k {
            200 => rig.follow(Mode::Hold),
            220 => rig.follow(place.start.mode()),
            _ => {}
        }
    })
}

const STATIC: &[Start] = &[
    Start::Torque,
    Start::InverseDynamics,
    Start::Hold,
    Start::Passive,
    Start::TorqueFeedback,
    Start::LowGain,
    Start::Stand,
    Start::Cartesian,
    Start::Pressing,
];

pub(super) fn scenarios() -> Vec<Scenario> {
    let new = |name, starts, make| Scenario::new(GROUP, name, starts, make);
    let mut all = vec![
        new("client killed", FOLLOWING_PRESSING, killed).step(),
        new("client's references get older", FOLLOWING_PRESSING, silent).step(),
        new("client killed, comes back after 0.2 s", MODES, comes_back).step(),
        new("change to hold", FOLLOWING_PRESSING, |_| {
            change_to(Mode::Hold)
        })
        .step(),
        new("change to torque", STATIC, |_| change_to(Mode::Torque))
            .step()
            .ideal(|_| true),
        new("change to inverse dynamics", STATIC, |_| {
            change_to(Mode::InverseDynamics)
        })
        .step(),
        new("mode and hold by turns, 20 ms each", MODES, back_and_forth),
        new("references in the wrong order", FOLLOWING, reordered),
        new("unknown mode", MODES, |_| reference(|r, _| r.mode = 77)).step(),
        new("wrong number of joints", MODES, |_| {
            reference(|r, _| r.joint_count += 1)
        })
        .step(),
        new("q_d of all joints zero", FOLLOWING, |_| {
            reference(|r, _| r.joints.iter_mut().for_each(|j| j.q_d = 0.0))
        }),
        new("the same from hold, as first reference", HOLD, |_| {
            client(|rig, k| {
                if k == 0 {
                    rig.follow(Mode::InverseDynamics);
                }
                rig.client
                    .reference
                    .joints
                    .iter_mut()
                    .for_each(|j| j.q_d = 0.0);
            })
        }),
    ];
    all.extend(fields().map(|(name, make)| new(name, MODES, make)));
    all.extend([
        new("desired contact force of 1e6 N", MODES, |_| {
            reference(|r, _| {
                r.contact_wrench_given = 1;
                r.contact_wrench[0].force = [1e6; 3];
            })
        }),
        new("desired contact wrench not finite", MODES, |_| {
            reference(|r, _| {
                r.contact_wrench_given = 1;
                r.contact_wrench[0].torque[1] = f64::NAN;
            })
        })
        .step(),
        new("age of the reference not finite", MODES, |_| {
            client(|rig, _| rig.client.age_s = f64::NAN)
        })
        .step(),
        new("a tare of 100 N is adopted", ENABLED, |_| {
            settings(|s, _, _| s.ft_offset[0].force[2] = 100.0)
        }),
        new("a tare that is not finite", AT_REST, |_| {
            settings(|s, _, _| s.ft_offset[0].force[2] = f64::NAN)
        }),
        new("storm of tares and contact sets", AT_REST, |_| {
            settings(|s, k, r| {
                s.ft_offset[0].force[2] = 20.0 * r;
                s.contact_set = (k % 7) as u32;
            })
        }),
        new("storm of wrong acknowledgements", AT_REST, |_| {
            requests(|k, _| Some(OperatorRequest::Acknowledge(k as u32)))
        }),
        new("storm of stop and enable", ENABLED, |_| {
            requests(|k, _| {
                Some(match k % 2 {
                    0 => OperatorRequest::Stop,
                    _ => OperatorRequest::Enable,
                })
            })
        })
        .step(),
        new("stop", ENABLED, |_| {
            requests(|k, _| (k == 0).then_some(OperatorRequest::Stop))
        })
        .step(),
        new("disable", AT_REST, |_| {
            requests(|k, _| (k == 0).then_some(OperatorRequest::Disable))
        })
        .physics(),
        new("storm of enable and disable", AT_REST, |_| {
            requests(|k, _| {
                Some(if k % 50 < 25 {
                    OperatorRequest::Disable
                } else {
                    OperatorRequest::Enable
                })
            })
        })
        .physics(),
    ]);
    all
}

type Make = fn(Place) -> Fault;

/// Every field of a joint's reference, not finite and far too large.
fn fields() -> impl Iterator<Item = (&'static str, Make)> {
    let all: [(&str, Make); 10] = [
        ("q_d not a number", |p| field(p, |j| j.q_d = f64::NAN)),
        ("dq_d infinite", |p| field(p, |j| j.dq_d = f64::INFINITY)),
        ("ddq_d infinite", |p| {
            field(p, |j| j.ddq_d = f64::NEG_INFINITY)
        }),
        ("tau_d not a number", |p| field(p, |j| j.tau_d = f64::NAN)),
        ("q_d 1e300", |p| field(p, |j| j.q_d = 1e300)),
        ("q_d steps by 0.5 rad", |p| field(p, |j| j.q_d += 0.5)),
        ("dq_d 1e6 rad/s", |p| field(p, |j| j.dq_d = 1e6)),
        ("dq_d 100 rad/s", |p| field(p, |j| j.dq_d = 100.0)),
        ("ddq_d 1e6 rad/s²", |p| field(p, |j| j.ddq_d = 1e6)),
        ("tau_d 1e6 N·m", |p| field(p, |j| j.tau_d = 1e6)),
    ];
    all.into_iter()
}
