//! Set-up of a drive of CiA 402, from whatever state it is in to operational.

use super::*;

impl Drive<'_> {
    /// Its set-up, from whatever state it is in to operational.
    ///
    /// # Errors
    /// As [`process_data`](Self::process_data), and a node that there cannot be.
    pub fn plan(&self) -> Result<Plan, Problem> {
        if !NODES.contains(&self.node) || self.node == MASTER {
            let what = format!("node {} is not allowed", self.node);
            return Err(Problem::new(what, "1 to 126; 127 is the daemon's"));
        }
        let mut steps = vec![Step::ResetCommunication];
        self.identity(&mut steps);
        self.supervision(&mut steps);
        for (object, value) in &self.kind.sdo {
            steps.push(write(*object, "as configured", value.clone()));
        }
        self.limits(&mut steps);
        self.mapping(&mut steps)?;
        self.mode(&mut steps);
        Ok(Plan {
            bus: self.bus,
            node: self.node,
            name: self.name.to_owned(),
            steps,
        })
    }

    fn identity(&self, steps: &mut Vec<Step>) {
        let kind = self.kind;
        let other = "another device has this node id, or the configuration names another drive";
        let read = |sub, meaning, value: Option<u32>| {
            Step::Read(Check {
                object: Object::new(0x1018, sub),
                meaning,
                mask: value.map_or(0, |_| u32::MAX),
                value: value.unwrap_or(0),
                cure: other.to_owned(),
                optional: value.is_none(),
                awaited: false,
            })
        };
        steps.push(Step::Read(Check {
            object: Object::new(0x1000, 0),
            meaning: "device type",
            mask: 0xFFFF,
            value: 402,
            cure: format!("a drive of CiA 402 is expected: {other}"),
            optional: false,
            awaited: false,
        }));
        steps.push(read(1, "maker", kind.vendor));
        steps.push(read(2, "product", kind.product));
        steps.push(read(3, "revision", None));
        steps.push(read(4, "serial number", None));
        steps.push(Step::Read(Check {
            object: MODES,
            meaning: "modes of operation",
            mask: kind.mode.supported(),
            value: kind.mode.supported(),
            cure: format!(
                "the drive lacks mode {}: use the other command",
                kind.mode.number()
            ),
            optional: true,
            awaited: false,
        }));
        let rated = (kind.rated_current * 1000.0).round() as u32;
        steps.push(Step::Read(Check {
            object: RATED_CURRENT,
            meaning: "rated current, mA",
            mask: u32::MAX,
            value: rated,
            cure:
                "set rated_current_A to what the drive has, or the drive to the motor's data sheet"
                    .to_owned(),
            optional: true,
            awaited: false,
        }));
    }

    /// Who watches whom: the drive the daemon, and what it does when that falls silent.
    fn supervision(&self, steps: &mut Vec<Step>) {
        let ms = self.kind.heartbeat_ms;
        let consumer = u32::from(MASTER) << 16 | u32::from(ms);
        let own = (ms / 2).max(10).to_le_bytes().to_vec();
        let heard = Object::new(0x1016, 1);
        steps.push(write(
            heard,
            "heartbeat of the daemon that it expects",
            le(consumer),
        ));
        let heartbeat = write(Object::new(0x1017, 0), "its own heartbeat, ms", own);
        steps.push(match heartbeat {
            // CiA 301 allows a constant.
            Step::Write(write) => Step::Write(Write {
                may_be_fixed: true,
                ..write
            }),
            step => step,
        });
        // Quick stop; a drive without the object does what its maker chose.
        let quick_stop = 3i16.to_le_bytes().to_vec();
        let lost = Object::new(0x6007, 0);
        steps.push(optional(
            lost,
            "reaction to a lost daemon: quick stop",
            quick_stop,
        ));
    }

    /// Limits of its own: torque, current, positions, following error.
    fn limits(&self, steps: &mut Vec<Step>) {
        let Some(asked) = self.asked else {
            return;
        };
        let kind = self.kind;
        let bound = |index, sub, meaning, asked, key| Bound {
            object: Object::new(index, sub),
            meaning,
            signed: false,
            lower: false,
            count: 1.0,
            unit: "counts",
            asked,
            key,
            none: &[],
        };
        let limit = "torque_limit_Nm";
        steps.push(Step::Compare(Bound {
            count: kind.rated_torque / 1000.0,
            unit: "N·m",
            none: &[0xFFFF],
            ..bound(0x6072, 0, "greatest torque", asked.torque, limit)
        }));
        steps.push(Step::Compare(Bound {
            count: kind.rated_current / 1000.0,
            unit: "A",
            none: &[0xFFFF],
            ..bound(
                0x6073,
                0,
                "greatest current",
                asked.current,
                "the current of torque_limit_Nm",
            )
        }));
        if kind.mode != Mode::Position {
            return;
        }
        if let Some([least, most]) = asked.positions {
            let key = "the joint's position limit";
            let signed = |sub, meaning, asked| Bound {
                signed: true,
                none: &[0, -0x8000_0000, 0x7FFF_FFFF],
                ..bound(0x607D, sub, meaning, asked, key)
            };
            steps.push(Step::Compare(Bound {
                lower: true,
                ..signed(1, "least position", least)
            }));
            steps.push(Step::Compare(signed(2, "greatest position", most)));
        }
        steps.push(Step::Compare(Bound {
            none: &[0xFFFF_FFFF],
            ..bound(
                0x6065,
                0,
                "following error",
                asked.lead,
                "the lead of set-points at the torque limit",
            )
        }));
    }

    fn mapping(&self, steps: &mut Vec<Step>) -> Result<(), Problem> {
        let pdos = self.process_data()?;
        for direction in [0x1400, 0x1800] {
            for number in 0..u16::from(PDOS) {
                let parameter = direction + number;
                if !pdos.iter().any(|pdo| pdo.communication() == parameter) {
                    steps.push(Step::SwitchOff(parameter));
                }
            }
        }
        for pdo in &pdos {
            for written in pdo.writes(self.node) {
                steps.push(Step::Write(Write {
                    object: written.object,
                    meaning: "mapping of process data",
                    value: written.value,
                    mask: written.mask,
                    optional: false,
                    may_be_fixed: false,
                }));
            }
        }
        Ok(())
    }

    fn mode(&self, steps: &mut Vec<Step>) {
        let mode = self.kind.mode;
        let us = (self.period * 1e6).round().max(1.0) as u64;
        // Of powers of ten the largest that leaves a whole mantissa of one byte.
        let exact = (0..=6u32)
            .rev()
            .map(|p| (us / 10u64.pow(p), p, us % 10u64.pow(p)));
        let fits =
            |&(mantissa, _, rest): &(u64, u32, u64)| rest == 0 && (1..=255).contains(&mantissa);
        if let Some((mantissa, power, _)) = exact.into_iter().find(fits) {
            let exponent = power as i8 - 6;
            let meaning = "interval of set-points";
            steps.push(optional(
                Object::new(0x60C2, 1),
                meaning,
                vec![mantissa as u8],
            ));
            steps.push(optional(
                Object::new(0x60C2, 2),
                meaning,
                vec![exponent as u8],
            ));
        }
        steps.push(write(MODE, "mode of operation", vec![mode.number()]));
        match mode {
            // No jump by a target of zero.
            Mode::Position => steps.push(Step::Copy(POSITION, TARGET_POSITION)),
            Mode::Torque => {
                let zero = 0u16.to_le_bytes().to_vec();
                steps.push(write(TARGET_TORQUE, "no torque", zero));
            }
        }
        steps.push(Step::Start);
        steps.push(Step::Read(Check {
            object: MODE_DISPLAY,
            meaning: "mode of operation that the drive is in",
            mask: 0xFF,
            value: u32::from(mode.number()),
            cure: "the drive does not take this mode: see 6502 and its manual".to_owned(),
            optional: false,
            awaited: true,
        }));
    }
}

fn le(value: u32) -> Vec<u8> {
    value.to_le_bytes().to_vec()
}

fn write(object: Object, meaning: &'static str, value: Vec<u8>) -> Step {
    Step::Write(Write {
        object,
        meaning,
        value,
        mask: u32::MAX,
        optional: false,
        may_be_fixed: false,
    })
}

fn optional(object: Object, meaning: &'static str, value: Vec<u8>) -> Step {
    match write(object, meaning, value) {
        Step::Write(write) => Step::Write(Write {
            optional: true,
            ..write
        }),
        step => step,
    }
}
