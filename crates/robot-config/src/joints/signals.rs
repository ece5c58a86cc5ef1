//! Signals of a joint on its bus, and whether its encoders' turns can be counted.

use super::Reader;
use super::node::Messages;
use crate::drives::{Drive, link_counts_key};
use crate::reader::{Allowed, At};
use crate::slots;
use crate::units::Quantity;
use crate::wiring::{Reach, Use, Way, Wiring};
use estimators::encoder::EncoderParameters;
use robot_state::{JointKind, reported_flags};
use supervisor::Limits;

/// The ranges of a joint's encoders, and which optional signals it has.
pub(super) struct Signals {
    pub(super) motor_angle: Option<Reach>,
    pub(super) link_angle: Option<Reach>,
    pub(super) current: Option<Reach>,
    pub(super) has_velocity: bool,
    pub(super) has_status: bool,
    pub(super) has_control: bool,
    /// What the drive reports of itself, bits of `reported_flags`.
    pub(super) reports: u32,
}

impl Reader<'_, '_, '_> {
    pub(super) fn signals(
        &self,
        bus: usize,
        drive: &Drive,
        messages: Option<&Messages>,
        wiring: &mut Wiring<'_, '_>,
    ) -> Signals {
        let joint = self.index;
        let motor_counts = Quantity::Angle {
            counts_per_turn: drive.motor_counts_per_turn,
            key: "motor_counts_per_turn",
        };
        let has_link = self.has_link;
        let kind = self.section.kind;
        let (counts, key) = (drive.link_counts, link_counts_key(kind));
        let link_counts = match kind {
            JointKind::Revolute => Quantity::Angle {
                counts_per_turn: counts,
                key,
            },
            JointKind::Prismatic => Quantity::Length {
                counts_per_mm: counts,
                key,
            },
        };
        let set_point = if drive.model.takes_position() {
            link_counts
        } else {
            Quantity::Current
        };
        let mut signal = |key, way, slot, quantity| {
            let how = Use {
                way,
                bus,
                slot,
                quantity,
                sign: 1.0,
                offset: 0.0,
            };
            self.signal(key, how, messages, wiring)
        };
        let receive = |key, slot, quantity| (key, Way::Receive, slot, quantity);
        let [has_velocity, has_status, has_control] =
            ["velocity", "status", "control"].map(|key| {
                let made = messages.is_some_and(|messages| messages.signal(key).is_some());
                self.section.has(key) || made
            });
        let reported = [
            (
                "temperature",
                slots::temperature(joint),
                Quantity::Temperature,
            ),
            ("voltage", slots::voltage(joint), Quantity::Voltage),
            ("drive_torque", slots::drive_torque(joint), Quantity::Torque),
            ("drive_error", slots::drive_error(joint), Quantity::Status),
        ];
        let flags = [
            reported_flags::TEMPERATURE,
            reported_flags::VOLTAGE,
            reported_flags::TORQUE,
            reported_flags::ERROR,
        ];
        let mut reports = 0;
        for ((key, slot, quantity), flag) in reported.into_iter().zip(flags) {
            let made = messages.is_some_and(|messages| messages.signal(key).is_some());
            if self.section.has(key) || made {
                let _noted = signal(key, Way::Receive, slot, quantity);
                reports |= flag;
            }
        }
        let control = (
            "control",
            Way::Send,
            slots::control(joint),
            Quantity::Status,
        );
        let optional = [
            has_velocity.then(|| receive("velocity", slots::velocity(joint), Quantity::Velocity)),
            has_status.then(|| receive("status", slots::status(joint), Quantity::Status)),
            has_control.then_some(control),
        ];
        let required = [("set_point", Way::Send, slots::command(joint), set_point)];
        let current = signal(
            "current",
            Way::Receive,
            slots::current(joint),
            Quantity::Current,
        );
        for (key, way, slot, quantity) in required.into_iter().chain(optional.into_iter().flatten())
        {
            let _noted = signal(key, way, slot, quantity);
        }
        Signals {
            motor_angle: signal(
                "motor_angle",
                Way::Receive,
                slots::motor_angle(joint),
                motor_counts,
            ),
            link_angle: has_link
                .then(|| {
                    signal(
                        "link_angle",
                        Way::Receive,
                        slots::link_angle(joint),
                        link_counts,
                    )
                })
                .flatten(),
            current,
            has_velocity,
            has_status,
            has_control,
            reports,
        }
    }

    /// Maps one signal: from its table, or as its drive's profile has it.
    fn signal(
        &self,
        key: &'static str,
        how: Use,
        messages: Option<&Messages>,
        wiring: &mut Wiring<'_, '_>,
    ) -> Option<Reach> {
        let made = messages.and_then(|messages| messages.signal(key));
        let (sign, offset) = made.map_or((1.0, 0.0), |made| (made.sign, made.offset));
        let section = match made {
            Some(_) if !self.section.has(key) => {
                let how = Use {
                    sign,
                    offset,
                    ..how
                };
                let place = self.section.place();
                let value = made?.path.as_str();
                return wiring.connect(&self.section.path(key), &At { value, place }, &how);
            }
            _ => self.section.section(key)?,
        };
        // The motor's angle is an angle, whatever its joint is.
        let section = section.of_kind(match how.quantity {
            Quantity::Length { .. } => JointKind::Prismatic,
            _ => JointKind::Revolute,
        });
        let sign = match how.quantity {
            Quantity::Status | Quantity::Temperature | Quantity::Voltage => 1.0,
            _ => section.sign_or("direction", sign),
        };
        let offset = if how.quantity.is_position() && section.has("offset_deg") {
            section
                .kind
                .si(section.number("offset_deg", Allowed::Finite))
        } else {
            offset
        };
        let how = Use {
            sign,
            offset,
            ..how
        };
        let path = match made {
            Some(made) if !section.has("signal") => Some(At {
                value: made.path.as_str(),
                place: section.place(),
            }),
            _ => section.text("signal", "MESSAGE.signal"),
        };
        let reach = path.and_then(|path| wiring.connect(&section.path("signal"), &path, &how));
        section.finish();
        reach
    }

    /// Notes encoders whose turns cannot be counted.
    pub(super) fn wraps(&self, encoders: &EncoderParameters, limits: &Limits) {
        let travel = encoders.max_velocity * encoders.sample_period;
        let kind = self.section.kind;
        let sides = [
            (
                "motor_angle",
                encoders.motor_wrap,
                travel * encoders.gear_ratio,
                "rad".into(),
            ),
            ("link_angle", encoders.link_wrap, travel, kind.units("rad")),
        ];
        for (key, wrap, travel, unit) in sides {
            if wrap <= 2.0 * travel {
                let what = format!(
                    "the signal starts again after {wrap:.4} {unit}, and the joint can move {travel:.4} {unit} in a cycle"
                );
                let allowed =
                    kind.units("a range of more than twice that, see drive.max_velocity_rad_per_s");
                self.section.problem(key, what, allowed);
            }
        }
        let range = (limits.position_min, limits.position_max);
        // Without a link-side encoder nothing but its range shows the motor's turn.
        let (key, wrap) = if self.has_link {
            ("link_angle", encoders.link_wrap)
        } else {
            ("motor_angle", encoders.motor_wrap / encoders.gear_ratio)
        };
        let half = 0.5 * wrap;
        if range.0.is_finite() && range.1.is_finite() && (range.0 < -half || range.1 > half) {
            let what = format!(
                "the signal starts again after {:.3} {unit} of the joint, and the joint moves from {:.3} to {:.3} {unit}",
                kind.shown(wrap),
                kind.shown(range.0),
                kind.shown(range.1),
                unit = kind.units("deg"),
            );
            let allowed = "position limits within half the signal's range on either side of zero";
            self.section.problem(key, what, allowed);
        }
    }
}
