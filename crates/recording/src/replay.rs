//! Replay: the cycle computed again from what a recorded run has received.

use can_codec::Frames;
use cycle::{Cycle, OperatorRequest};
use problem::Problem;
use robot_config::Robot;
use robot_state::{CycleRecord, Event, RobotState, TorqueEstimate, torque_flags};
use zerocopy::IntoBytes;

use crate::check::Checker;
use crate::compact::Counts;
use crate::fields::Fields;
use crate::frames::RECORD_HEAD;
use crate::header::Header;
use crate::message::CycleMessage;

/// The first number that was not computed again as it was recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// The cycle.
    pub cycle: u64,
    /// The field, with joint or sensor by name; or the frame sent.
    pub field: String,
    /// The recorded value.
    pub recorded: String,
    /// The value computed now.
    pub replayed: String,
}

/// Difference of one of a joint's torques between recording and replay.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TorqueDifference {
    /// Cycles in which both were valid.
    pub cycles: u64,
    /// Sum of squares, (N·m)².
    squares: f64,
    /// Largest difference, N·m.
    pub largest: f64,
    /// The cycle in which it was so large.
    pub largest_at: u64,
}

impl TorqueDifference {
    /// Root of the mean square, N·m.
    #[must_use]
    pub fn rms(&self) -> f64 {
        match self.cycles {
            0 => 0.0,
            cycles => (self.squares / cycles as f64).sqrt(),
        }
    }

    fn add(&mut self, difference: f64, cycle: u64) {
        self.cycles += 1;
        self.squares += difference * difference;
        if difference.is_nan() || difference.abs() > self.largest {
            (self.largest, self.largest_at) = (difference.abs(), cycle);
        }
    }
}

/// The torques of a joint that are compared, in the order of [`Replayed::joints`].
pub const TORQUES: [&str; 6] = [
    "tau_encoder",
    "tau_whole_body",
    "tau_current",
    "tau_hat",
    "tau_d",
    "tau_star",
];

/// The result of a replay.
#[derive(Debug, Clone, Default)]
pub struct Replayed {
    /// Cycles computed.
    pub cycles: u64,
    /// Cycles that are missing in the recording, and where: each makes what follows differ.
    pub missing: Vec<(u64, u64)>,
    /// The first cycle's number; above 1 the computation starts without what it knew before.
    pub first_cycle: u64,
    /// The first difference of any bit.
    pub first_difference: Option<Difference>,
    /// Cycles with a difference.
    pub different: u64,
    /// For each joint, of each of [`TORQUES`].
    pub joints: Vec<[TorqueDifference; TORQUES.len()]>,
}

impl Replayed {
    /// Every bit of every cycle was computed again as recorded.
    #[must_use]
    pub fn is_bit_exact(&self) -> bool {
        self.cycles > 0 && self.different == 0
    }
}

/// Computes a recorded run again.
pub struct Replay {
    cycle: Cycle,
    tx: Frames,
    fields: Fields,
    checker: Checker,
    header: Header,
    result: Replayed,
    last: Option<u64>,
}

impl Replay {
    /// With the robot of the recording, or one that differs in its parameters.
    ///
    /// # Errors
    /// A recording of torques alone; another robot: other joints, sensors or IMUs; those of
    /// [`Cycle::new`].
    pub fn new(robot: &Robot, header: &Header) -> Result<Self, Problem> {
        header.demand_inputs()?;
        let own = Header::new(robot, Vec::new(), header.start);
        for (kind, own, recorded) in [
            ("joints", &own.joints, &header.joints),
            ("F/T sensors", &own.sensors, &header.sensors),
            ("IMUs", &own.imus, &header.imus),
        ] {
            if own != recorded {
                return Err(Problem::new(
                    format!("the configuration has the {kind} {}", own.join(", ")),
                    format!(
                        "those of the recording, in its order: {}",
                        recorded.join(", ")
                    ),
                ));
            }
        }
        let counts: Counts = header.counts();
        Ok(Self {
            cycle: Cycle::new(robot)?,
            tx: Frames::default(),
            fields: Fields::new::<CycleRecord>(counts),
            checker: Checker::new(counts),
            header: header.clone(),
            result: Replayed {
                joints: vec![Default::default(); counts.joints],
                ..Replayed::default()
            },
            last: None,
        })
    }

    /// Computes one cycle and compares it; the record that was computed.
    pub fn step(&mut self, message: &CycleMessage) -> &CycleRecord {
        let recorded = &message.record.cycle;
        match self.last {
            None => self.begin(recorded),
            Some(last) if recorded.sequence > last + 1 => {
                self.result
                    .missing
                    .push((last + 1, recorded.sequence - last - 1));
            }
            Some(_) => {}
        }
        self.last = Some(recorded.sequence);
        for (event, times) in &message.notes {
            self.cycle.note(*event, *times);
        }
        let mut client = message.client();
        client.request = client.request.or_else(|| self.catch_up(recorded));
        self.tx.clear();
        self.cycle
            .step(message.at, &message.rx, &client, &mut self.tx);
        self.result.cycles += 1;
        match message.check {
            Some(check) => self.compare_checks(recorded.sequence, check),
            None => {
                self.compare(message);
                self.compare_torques(recorded);
            }
        }
        self.cycle.record()
    }

    /// Computes one cycle of a recording of frames, and puts into its message what that lacks.
    pub fn restore(&mut self, message: &mut CycleMessage) {
        self.step(message);
        let recorded = &message.record.cycle;
        let mut head = *self.cycle.record();
        // What was recorded stays, also where a recording that begins later is computed otherwise.
        head.as_mut_bytes()[..RECORD_HEAD].copy_from_slice(&recorded.as_bytes()[..RECORD_HEAD]);
        message.record.cycle = head;
        message.check = None;
        message.tx.clear();
        for frame in &self.tx {
            message.tx.push(*frame);
        }
    }

    fn compare_checks(&mut self, cycle: u64, recorded: u32) {
        let replayed = self.checker.of(self.cycle.record(), &self.tx);
        if recorded == replayed {
            return;
        }
        self.result.different += 1;
        let shown = |check: u32| format!("CRC-32 {check:08x}");
        self.result
            .first_difference
            .get_or_insert_with(|| Difference {
                cycle,
                field: "the record or a frame sent".to_owned(),
                recorded: shown(recorded),
                replayed: shown(replayed),
            });
    }

    /// Differences found so far.
    #[must_use]
    pub fn result(&self) -> &Replayed {
        &self.result
    }

    fn begin(&mut self, first: &CycleRecord) {
        self.result.first_cycle = first.sequence;
        let latched = match first.sequence {
            1 => self.header.start.fault,
            _ => Event::from_number(first.fault),
        };
        if let Some(fault) = latched {
            self.cycle.start_with_fault(fault);
        }
    }

    /// A recording that begins when the robot was enabled already lacks the request.
    fn catch_up(&self, recorded: &CycleRecord) -> Option<OperatorRequest> {
        let on = [RobotState::Holding.number(), RobotState::Active.number()];
        let ready = self.cycle.record().state == RobotState::Ready.number();
        let late = self.result.first_cycle > 1;
        (late && ready && on.contains(&recorded.state)).then_some(OperatorRequest::Enable)
    }

    fn compare(&mut self, message: &CycleMessage) {
        let (recorded, replayed) = (&message.record.cycle, self.cycle.record());
        let (one, other) = (recorded.as_bytes(), replayed.as_bytes());
        let field = (one != other).then(|| self.fields.first_difference(one, other));
        let field = field.flatten();
        let frame = first_other_frame(&message.tx, &self.tx);
        if field.is_none() && frame.is_none() {
            return;
        }
        self.result.different += 1;
        if self.result.first_difference.is_some() {
            return;
        }
        let (field, recorded, replayed) = match (field, frame) {
            (Some(field), _) => (
                field.named(&self.header),
                field.text(one),
                field.text(other),
            ),
            (None, Some(frame)) => frame,
            (None, None) => return,
        };
        self.result.first_difference = Some(Difference {
            cycle: message.record.cycle.sequence,
            field,
            recorded,
            replayed,
        });
    }

    fn compare_torques(&mut self, recorded: &CycleRecord) {
        let replayed = self.cycle.record();
        let (estimated, commanded) = (&recorded.estimated.joints, &recorded.commanded.joints);
        let old = estimated.iter().zip(commanded);
        let new = replayed
            .estimated
            .joints
            .iter()
            .zip(&replayed.commanded.joints);
        for ((old, new), sums) in old.zip(new).zip(&mut self.result.joints) {
            let estimates = [
                (&old.0.tau_encoder, &new.0.tau_encoder),
                (&old.0.tau_whole_body, &new.0.tau_whole_body),
                (&old.0.tau_current, &new.0.tau_current),
                (&old.0.tau_hat, &new.0.tau_hat),
            ];
            let commands = [(old.1.tau_d, new.1.tau_d), (old.1.tau_star, new.1.tau_star)];
            let estimates = estimates
                .map(|(old, new)| (is_valid(old) && is_valid(new)).then_some(new.tau - old.tau));
            let commands = commands.map(|(old, new)| Some(new - old));
            let differences = estimates.into_iter().chain(commands);
            for (sum, difference) in sums.iter_mut().zip(differences) {
                if let Some(difference) = difference {
                    sum.add(difference, recorded.sequence);
                }
            }
        }
    }
}

fn is_valid(estimate: &TorqueEstimate) -> bool {
    let bad = torque_flags::DEGRADED;
    estimate.flags & (torque_flags::VALID | bad) == torque_flags::VALID
}

/// The first frame that was sent otherwise.
fn first_other_frame(recorded: &Frames, replayed: &Frames) -> Option<(String, String, String)> {
    let text = |frame: Option<&can_codec::Frame>| {
        frame.map_or_else(
            || "no frame".to_owned(),
            |f| format!("bus {} id {:#x} {:02x?}", f.bus, f.id, f.payload()),
        )
    };
    let longest = recorded.len().max(replayed.len());
    let frame = |frames: &Frames, i: usize| frames.as_slice().get(i).copied();
    (0..longest).find_map(|i| {
        let (one, other) = (frame(recorded, i), frame(replayed, i));
        (one != other).then(|| {
            let field = format!("frame {} sent", i + 1);
            (field, text(one.as_ref()), text(other.as_ref()))
        })
    })
}
