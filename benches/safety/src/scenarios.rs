//! The scenarios: what goes wrong, in which states of the robot, and what must hold.

mod bus;
mod client;
mod drive;
mod encoder;
mod errant;
mod frame;
mod process;
mod sensor;
mod start;

use crate::rig::{At, Fault, Rig};
use crate::robots::{Drives, Prepared, Variant};
pub use start::Start;

/// Condition that must hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bound {
    /// At most 1 degree and 10 % of the velocity limit.
    Motion,
    /// And no torque step of more than 5 % of the torque limit.
    MotionAndStep,
    /// The fault itself moves the joint: at most as far and as fast as with set-points that stay as
    /// they were, or the bounds of [`Bound::Motion`].
    Physics,
    /// Nothing but a torque holds the joint, and that changes: it moves no faster than the velocity limit of
    /// such modes.
    Torque,
    /// A client asks for a force where there is nothing to press on: the frame goes with it, at no more than the
    /// share of the velocity limit of [`Bound::Motion`] and without a step.
    Approach,
    /// Every sensor of the joint shows a motion at this rate, rad/s, that is none: the joint follows
    /// it, no further, at no more than the share of the velocity limit of [`Bound::Motion`].
    Shown(f64),
    /// A drive follows something else than its set-points: 1 degree, and 45 % of the velocity limit, as the first
    /// milliseconds of it cannot be seen.
    Straying,
    /// No set-points come for so many cycles: the bounds of [`Bound::MotionAndStep`], or by no more
    /// beyond that torque step than a drive makes whose set-point stands for as long.
    Gap(usize),
}

/// Where a fault strikes.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// The robot.
    pub variant: Variant,
    /// The joint, in config order.
    pub joint: usize,
    /// Another joint.
    pub other: usize,
    /// The joint's bus.
    pub bus: u8,
    /// State at the beginning.
    pub start: Start,
}

/// One fault.
#[derive(Clone, Copy)]
pub struct Scenario {
    /// Heading on the page.
    pub group: &'static str,
    /// The fault.
    pub name: &'static str,
    /// The states in which it begins.
    pub starts: &'static [Start],
    /// Condition that must hold.
    pub bound: Bound,
    /// The same of drives that take currents, where it differs.
    pub bound_of_currents: Option<Bound>,
    /// Where a client commands the torque: an ideal source of that torque is compared with.
    pub ideal: fn(&Place) -> bool,
    /// The robots that it can happen to.
    pub on: fn(&Variant) -> bool,
    /// Done to the robot when it is switched on.
    pub setup: Option<fn(&mut Rig, &Place)>,
    /// The fault.
    pub make: fn(Place) -> Fault,
}

use Start::{
    Cartesian, Hold, InverseDynamics, LowGain, Motion, Passive, PowerOn, Pressing, Stand, Torque,
    TorqueFeedback,
};

pub(crate) const ALL_STARTS: &[Start] = &[
    PowerOn,
    Hold,
    Torque,
    InverseDynamics,
    Motion,
    Passive,
    TorqueFeedback,
    LowGain,
    Stand,
    Cartesian,
];
pub(crate) const ENABLED: &[Start] = &[
    Hold,
    Torque,
    InverseDynamics,
    Motion,
    Passive,
    TorqueFeedback,
    LowGain,
    Stand,
    Cartesian,
];
/// Motion allowed besides to a frame that presses.
pub(crate) const ENABLED_PRESSING: &[Start] = &[
    Hold,
    Torque,
    InverseDynamics,
    Motion,
    Passive,
    TorqueFeedback,
    LowGain,
    Stand,
    Cartesian,
    Pressing,
];
pub(crate) const AT_REST: &[Start] = &[
    Hold,
    Torque,
    InverseDynamics,
    Passive,
    TorqueFeedback,
    LowGain,
    Stand,
    Cartesian,
];
pub(crate) const MODES: &[Start] = &[
    Torque,
    InverseDynamics,
    Passive,
    TorqueFeedback,
    LowGain,
    Stand,
    Cartesian,
];
pub(crate) const FOLLOWING: &[Start] = &[
    Torque,
    InverseDynamics,
    Motion,
    Passive,
    TorqueFeedback,
    LowGain,
    Stand,
    Cartesian,
];
pub(crate) const FOLLOWING_PRESSING: &[Start] = &[
    Torque,
    InverseDynamics,
    Motion,
    Passive,
    TorqueFeedback,
    LowGain,
    Stand,
    Cartesian,
    Pressing,
];
pub(crate) const CARTESIAN: &[Start] = &[Cartesian, Pressing];
/// Modes from which a client goes over to leading frames.
pub(crate) const UNLED: &[Start] = &[Torque, InverseDynamics];
pub(crate) const PRESSING: &[Start] = &[Pressing];
/// Every state.
const EVERY: &[Start] = &[
    PowerOn,
    Hold,
    Torque,
    InverseDynamics,
    Motion,
    Passive,
    TorqueFeedback,
    LowGain,
    Stand,
    Cartesian,
    Pressing,
];
/// Of the humanoid, which takes its time, those in which most can go wrong.
const OF_HUMANOID: &[Start] = &[
    PowerOn,
    Hold,
    InverseDynamics,
    Passive,
    TorqueFeedback,
    LowGain,
    Stand,
];
pub(crate) const STAND: &[Start] = &[Stand];
pub(crate) const POWER_ON: &[Start] = &[PowerOn];
pub(crate) const HOLD: &[Start] = &[Hold];

impl Scenario {
    pub(crate) const fn new(
        group: &'static str,
        name: &'static str,
        starts: &'static [Start],
        make: fn(Place) -> Fault,
    ) -> Self {
        Self {
            group,
            name,
            starts,
            bound: Bound::Motion,
            bound_of_currents: None,
            ideal: |_| false,
            on: |_| true,
            setup: None,
            make,
        }
    }

    pub(crate) const fn step(self) -> Self {
        Self {
            bound: Bound::MotionAndStep,
            ..self
        }
    }

    pub(crate) const fn gap(self, cycles: usize) -> Self {
        Self {
            bound: Bound::Gap(cycles),
            ..self
        }
    }

    /// The joint moves as far and as fast as with an ideal source of the commanded torque, no more.
    pub(crate) const fn ideal(self, ideal: fn(&Place) -> bool) -> Self {
        Self { ideal, ..self }
    }

    pub(crate) const fn physics(self) -> Self {
        Self {
            bound: Bound::Physics,
            ..self
        }
    }

    /// Drives that take currents hear nothing: they go on with their last one.
    pub(crate) const fn physics_of_currents(self) -> Self {
        Self {
            bound_of_currents: Some(Bound::Physics),
            ..self
        }
    }

    /// All sensors of a joint show a motion at this rate, rad/s, which drives that take currents follow.
    pub(crate) const fn shown_to_currents(self, rate: f64) -> Self {
        Self {
            bound_of_currents: Some(Bound::Shown(rate)),
            ..self
        }
    }

    /// Conditions that must hold of this robot.
    pub(crate) fn bound_at(&self, place: &Place) -> Bound {
        let currents = place.variant.drives == Drives::Current;
        let of_currents = (self.bound_of_currents).filter(|_| currents);
        of_currents.unwrap_or(self.bound)
    }

    pub(crate) const fn straying(self) -> Self {
        Self {
            bound: Bound::Straying,
            ..self
        }
    }

    pub(crate) const fn torque(self) -> Self {
        Self {
            bound: Bound::Torque,
            ..self
        }
    }

    pub(crate) const fn approach(self) -> Self {
        Self {
            bound: Bound::Approach,
            ..self
        }
    }

    pub(crate) const fn with_states(self) -> Self {
        Self {
            on: |variant| variant.states,
            ..self
        }
    }

    pub(crate) const fn with_setup(self, setup: fn(&mut Rig, &Place)) -> Self {
        Self {
            setup: Some(setup),
            ..self
        }
    }

    pub(crate) const fn with_further_imus(self) -> Self {
        Self {
            on: |variant| variant.further_imus,
            ..self
        }
    }

    pub(crate) const fn with_imu(self) -> Self {
        Self {
            on: |variant| variant.robot != "leg",
            ..self
        }
    }

    /// Of robots with frames that can be led.
    pub(crate) const fn of_led_frames(self) -> Self {
        Self {
            on: |variant| variant.robot == "leg" && variant.states,
            ..self
        }
    }

    pub(crate) const fn of_two_encoders(self) -> Self {
        Self {
            on: |variant| variant.robot != "hrp2-like",
            ..self
        }
    }

    pub(crate) const fn of_position_drives(self) -> Self {
        Self {
            on: |variant| variant.drives == Drives::Position,
            ..self
        }
    }

    /// Of drives that take positions, can be switched off, and whose joints have two encoders.
    pub(crate) const fn of_switched_positions(self) -> Self {
        Self {
            on: |v| v.drives == Drives::Position && v.states && v.robot != "hrp2-like",
            ..self
        }
    }

    pub(crate) const fn of_current_drives(self) -> Self {
        Self {
            on: |variant| variant.drives == Drives::Current,
            ..self
        }
    }
}

/// Every scenario.
#[must_use]
pub fn all() -> Vec<Scenario> {
    [
        bus::scenarios(),
        process::scenarios(),
        encoder::scenarios(),
        sensor::scenarios(),
        frame::scenarios(),
        drive::scenarios(),
        errant::scenarios(),
        client::scenarios(),
    ]
    .concat()
}

/// The places at which a scenario strikes a robot; `all`: every one, else those of the page, of the
/// humanoid and of drives that are always on only the states in which most can go wrong.
#[must_use]
pub fn places(prepared: &Prepared, scenario: &Scenario, all: bool) -> Vec<Place> {
    let variant = prepared.variant;
    let starts: &[Start] = match (variant.robot, variant.states) {
        _ if all => EVERY,
        ("humanoid", false) => &[],
        ("humanoid", true) => OF_HUMANOID,
        (_, false) => HOLD,
        (_, true) => EVERY,
    };
    // Of the robot with further IMUs, only what concerns them.
    let concerns = !variant.further_imus || scenario.name.contains("IMU");
    if !((scenario.on)(&variant) && concerns) {
        return Vec::new();
    }
    let joints = &prepared.robot.parameters.joints;
    let index = |name: &str| {
        joints
            .iter()
            .position(|joint| joint.name == name)
            .unwrap_or(0)
    };
    // A strong joint and a weak one; of the humanoid in motion, joints that move.
    let strong_and_weak = |start: Start| match (variant.robot, start) {
        ("humanoid", Start::Motion | Start::Passive | Start::LowGain) => {
            [index("left_elbow"), index("left_wrist_pitch")]
        }
        ("humanoid", Start::Stand) => [index("left_knee"), index("left_ankle_roll")],
        ("humanoid", _) => [index("left_knee"), index("left_wrist_pitch")],
        ("lift-gripper", _) => [index("lift"), index("finger")],
        _ => [index("knee"), index("ankle_roll")],
    };
    let place = |start: Start, joint: usize, other: usize| Place {
        variant,
        joint,
        other,
        bus: joints[joint].bus as u8,
        start,
    };
    let of_start = |start: &Start| {
        let whole = all || variant.robot == "leg" || *start == Start::Stand;
        let both = whole && scenario.group == encoder::GROUP;
        let [strong, weak] = strong_and_weak(*start);
        let mut all = vec![place(*start, strong, weak)];
        if both {
            all.push(place(*start, weak, strong));
        }
        all
    };
    let begins = scenario
        .starts
        .iter()
        .filter(|start| starts.contains(start) && start.is_possible(prepared));
    begins.flat_map(of_start).collect()
}

/// A fault that acts at one place of the cycle.
pub(crate) fn at(place: At, mut act: impl FnMut(&mut Rig, usize) + 'static) -> Fault {
    Box::new(move |at, rig, k| {
        if at == place {
            act(rig, k);
        }
    })
}

/// A fault of the robot itself, or of the clock.
pub(crate) fn before(act: impl FnMut(&mut Rig, usize) + 'static) -> Fault {
    at(At::Before, act)
}

/// A fault of the answers.
pub(crate) fn answers(act: impl FnMut(&mut Rig, usize) + 'static) -> Fault {
    at(At::Answers, act)
}

/// A fault of the client.
pub(crate) fn client(act: impl FnMut(&mut Rig, usize) + 'static) -> Fault {
    at(At::Client, act)
}

/// A fault of the commands.
pub(crate) fn commands(act: impl FnMut(&mut Rig, usize) + 'static) -> Fault {
    at(At::Commands, act)
}

/// Both.
pub(crate) fn both(mut one: Fault, mut other: Fault) -> Fault {
    Box::new(move |at, rig, k| {
        one(at, rig, k);
        other(at, rig, k);
    })
}

/// Way of a joint, rad or m, that counts as much as this angle of the others'.
pub(crate) fn way(rig: &Rig, joint: usize, angle: f64) -> f64 {
    let kind = rig.robot.parameters.joints.get(joint).map(|j| j.kind);
    kind.unwrap_or_default().threshold(angle)
}

/// Numbers in (-1, 1) that a seed repeats: Marsaglia's xorshift.
pub(crate) fn noise(mut state: u64) -> impl FnMut() -> f64 {
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}
