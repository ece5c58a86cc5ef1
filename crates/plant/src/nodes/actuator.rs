//! A simulated actuator with frames of its maker's own: what all families share. Each family is a file beside it, written
//! from its maker's description or from other people's masters, apart from `crates/drives`.
//!
//! It makes torque only once it was enabled and then commanded, and stops by itself when no command comes for a while, as
//! set with the maker's tool.

use super::motor::Motor;
use super::wire::Wire;
use super::{cubemars, damiao, moteus, myactuator, odrive, robstride};
use can_codec::Frame;
use problem::Problem;
use robot_config::ActuatorSheet;

/// Time without a command after which it stops, ns: as its maker's tool has set it.
const TIME_OUT_NS: u64 = 200_000_000;

/// What is wrong with an actuator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trouble {
    /// No command came for too long.
    NoCommand,
    /// Number of an error of its drive.
    Drive(u32),
}

#[derive(Debug, Clone)]
enum Family {
    Cubemars,
    Damiao(damiao::Registers),
    Moteus,
    Myactuator,
    Odrive(odrive::Axis),
    Robstride(robstride::Parameters),
}

/// An actuator.
#[derive(Debug, Clone)]
pub(super) struct Actuator {
    pub(super) node: u8,
    pub(super) sheet: ActuatorSheet,
    powered: bool,
    on: bool,
    lost: bool,
    /// When it was enabled or commanded last, ns.
    commanded: u64,
    /// Time without a command after which it stops, ns; 0: none.
    pub(super) time_out: u64,
    family: Option<Family>,
}

impl Actuator {
    /// One that has just got its power.
    ///
    /// # Errors
    /// A family that is not simulated.
    pub(super) fn new(
        node: u8,
        sheet: &ActuatorSheet,
        motor: &mut Motor<'_>,
    ) -> Result<Self, Problem> {
        motor.let_go();
        let mut actuator = Self {
            node,
            sheet: sheet.clone(),
            powered: true,
            on: false,
            lost: false,
            commanded: 0,
            time_out: TIME_OUT_NS,
            family: None,
        };
        let family = actuator.at_power_on().ok_or_else(|| {
            let what = format!("drive.profile: {:?} is not simulated", sheet.family);
            Problem::new(
                what,
                "cubemars, damiao, moteus, myactuator, odrive, robstride",
            )
        })?;
        actuator.family = Some(family);
        Ok(actuator)
    }

    fn at_power_on(&self) -> Option<Family> {
        Some(match self.sheet.family {
            "cubemars" => Family::Cubemars,
            "damiao" => Family::Damiao(damiao::Registers::new(self)),
            "moteus" => Family::Moteus,
            "myactuator" => Family::Myactuator,
            "odrive" => Family::Odrive(odrive::Axis::default()),
            "robstride" => Family::Robstride(robstride::Parameters::default()),
            _ => return None,
        })
    }

    /// It sends its samples by a clock of its own.
    pub(super) fn sends_by_itself(&self) -> bool {
        matches!(self.family, Some(Family::Odrive(_)))
    }

    /// Switches its supply on or off.
    pub(super) fn set_power(&mut self, on: bool, motor: &mut Motor<'_>) {
        if on == self.powered {
            return;
        }
        self.disable(motor);
        self.powered = on;
        self.lost = false;
        self.family = self.at_power_on();
        if let Some(states) = motor.states() {
            states.set_power(on);
        }
    }

    /// What is due by time.
    pub(super) fn poll(&mut self, wire: &mut Wire<'_>, motor: &mut Motor<'_>) {
        if !self.powered {
            return;
        }
        self.on &= motor.states().is_some_and(|states| states.is_enabled());
        let silent = wire.now.saturating_sub(self.commanded);
        if self.on && self.time_out > 0 && silent > self.time_out {
            self.disable(motor);
            self.lost = true;
        }
        let mut family = self.family.take();
        if let Some(Family::Odrive(axis)) = &mut family {
            axis.poll(self, wire, motor);
        }
        self.family = family;
    }

    /// Takes a frame of its bus; true if it is one that it listens for.
    pub(super) fn hear(
        &mut self,
        frame: &Frame,
        wire: &mut Wire<'_>,
        motor: &mut Motor<'_>,
    ) -> bool {
        if !self.powered {
            return false;
        }
        let Some(mut family) = self.family.take() else {
            return false;
        };
        let heard = match &mut family {
            Family::Cubemars => cubemars::hear(self, frame, wire, motor),
            Family::Damiao(registers) => registers.hear(self, frame, wire, motor),
            Family::Moteus => moteus::hear(self, frame, wire, motor),
            Family::Myactuator => myactuator::hear(self, frame, wire, motor),
            Family::Odrive(axis) => axis.hear(self, frame, wire, motor),
            Family::Robstride(parameters) => parameters.hear(self, frame, wire, motor),
        };
        self.family = Some(family);
        heard
    }

    /// It is enabled: it makes the torque of the next command.
    pub(super) fn is_on(&self) -> bool {
        self.on
    }

    /// Switches on, unless something is wrong with it.
    pub(super) fn enable(&mut self, now: u64, motor: &mut Motor<'_>) {
        if self.trouble(motor).is_some() {
            return;
        }
        if let Some(states) = motor.states() {
            states.switch(true);
            self.on = states.is_enabled();
        }
        self.commanded = now;
        motor.let_go();
    }

    /// Switches off.
    pub(super) fn disable(&mut self, motor: &mut Motor<'_>) {
        motor.let_go();
        if let Some(states) = motor.states() {
            states.switch(false);
        }
        self.on = false;
    }

    /// Clears what is wrong.
    pub(super) fn clear(&mut self, motor: &mut Motor<'_>) {
        self.lost = false;
        if let Some(states) = motor.states() {
            states.clear();
        }
    }

    /// A command of the output, as [`Motor::follow_output`] takes it; without effect while it is off.
    pub(super) fn follow(&mut self, command: [f64; 5], now: u64, motor: &mut Motor<'_>) {
        if self.on {
            self.commanded = now;
            motor.follow_output(command);
        }
    }

    /// What is wrong with it.
    pub(super) fn trouble(&self, motor: &mut Motor<'_>) -> Option<Trouble> {
        if self.lost {
            return Some(Trouble::NoCommand);
        }
        let error = motor.states().map_or(0, |states| states.error());
        (error != 0).then_some(Trouble::Drive(error))
    }
}
