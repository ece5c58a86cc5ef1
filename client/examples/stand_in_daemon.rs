//! Publishes made-up records, so that client programs can be tried without a robot: joint `j`'s
//! torques are `j + sin t`, its measured position follows the last `q_d`. It has contacts "in_the_air"
//! and "standing", and a tare in the air "finds" an offset of 1 to 6. It starts holding; operators enable, disable and
//! stop it, and enabling it twice latches fault 404 for them to acknowledge. One client commands, by
//! lease, as with a daemon.
//!
//!     cargo run -p torqued-client --example stand_in_daemon -- ROBOT [SECONDS]

use std::error::Error;
use std::io::Write;
use std::thread::sleep;
use std::time::{Duration, Instant};

use control::{MotionLimits, TrajectoryLimits};
use nix::time::{ClockId, clock_gettime};
use supervisor::Commanders;
use torqued_client::robot_state::{
    Answer, CycleRecord, Description, Event, Mode, Name, Reference, Request, RobotState,
    SharedRecord, Text, Wrench, answer_status, not_followed, request, torque_flags, torque_source,
};
use torqued_client::{DaemonPorts, Location};

const JOINTS: usize = 6;
const CONTACTS: [&str; 2] = ["in_the_air", "standing"];
const PERIOD: Duration = Duration::from_millis(1);
const REFERENCE_TIMEOUT_S: f64 = 0.2;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let robot = args.next().unwrap_or_else(|| "stand_in".to_owned());
    let seconds: f64 = args.next().map_or(Ok(f64::INFINITY), |text| text.parse())?;

    let mut description = Description {
        robot: Name::new(&robot),
        rate_hz: 1.0 / PERIOD.as_secs_f64(),
        joint_count: JOINTS as u32,
        ..Description::default()
    };
    for j in 0..JOINTS {
        description.joint_names[j] = Name::new(&format!("joint_{j}"));
        description.torque_limits[j] = 100.0;
    }
    (description.ft_count, description.ft_names[0]) = (1, Name::new("ankle"));
    description.contact_set_count = CONTACTS.len() as u32;
    for (name, set) in description.contact_set_names.iter_mut().zip(CONTACTS) {
        *name = Name::new(set);
    }
    let ports = DaemonPorts::create(&Location::find()?, &description)?;
    println!("publishing {robot}");
    std::io::stdout().flush()?;

    let mut record = SharedRecord::default();
    record.cycle.joint_count = description.joint_count;
    record.cycle.state = RobotState::Holding.number();
    let limits = TrajectoryLimits {
        position_min: -1.0,
        position_max: 1.0,
        velocity: 5.0,
        acceleration: 100.0,
        stop: MotionLimits {
            velocity: 5.0,
            acceleration: 50.0,
            jerk: 1e3,
        },
    };
    let mut commanders = Commanders::new(REFERENCE_TIMEOUT_S).with_trajectories([limits; JOINTS]);
    let start = Instant::now();
    for cycle in 1u32.. {
        let t = f64::from(cycle) * PERIOD.as_secs_f64();
        if t > seconds {
            break;
        }
        let now_ns = monotonic_ns()?;
        while let Some(reference) = ports.next_reference()? {
            commanders.offer(&reference, now_ns);
        }
        while let Some(piece) = ports.next_piece()? {
            let _ = commanders.offer_piece(&piece);
        }
        commanders.begin_cycle(now_ns);
        record.cycle.commander = commanders.record();
        follow(commanders.reference(), &mut record.cycle);
        let events = &mut record.cycle.events[Event::CommanderRefused.index()];
        *events = u64::from(record.cycle.commander.refused);
        while let Some(asked) = ports.next_request()? {
            answer(&ports, &asked, &mut record)?;
        }
        record.cycle.sequence = u64::from(cycle);
        record.cycle.stamp_ns = u64::from(cycle) * PERIOD.as_nanos() as u64;
        record.timing.cycles = record.cycle.sequence;
        for (j, joint) in record.cycle.estimated.joints[..JOINTS]
            .iter_mut()
            .enumerate()
        {
            let tau = j as f64 + t.sin();
            for (estimate, source) in [
                (&mut joint.tau_encoder, torque_source::ENCODER),
                (&mut joint.tau_whole_body, torque_source::WHOLE_BODY),
            ] {
                (estimate.tau, estimate.source) = (tau, source);
                (estimate.sigma, estimate.flags) = (0.5, torque_flags::VALID);
            }
        }
        ports.publish(&record)?;
        if cycle % 100 == 0 {
            ports.cleanup_dead_clients();
        }
        sleep((start + PERIOD * cycle).saturating_duration_since(Instant::now()));
    }
    Ok(())
}

/// Follows the commander's reference, in state holding.
fn follow(reference: Option<&Reference>, cycle: &mut CycleRecord) {
    let holds = cycle.state == RobotState::Holding.number();
    let lease = &mut cycle.commander;
    (lease.not_followed, lease.cause) = match (cycle.fault, holds) {
        (0, true) => (0, 0),
        (0, false) => (not_followed::STATE, 0),
        (fault, _) => (not_followed::FAULT, fault),
    };
    let was = std::mem::replace(&mut cycle.mode, Mode::Hold.number());
    let Some(reference) = reference else {
        if was != Mode::Hold.number() {
            cycle.events[Event::ReferenceStale.index()] += 1;
        }
        return;
    };
    lease.sequence = reference.sequence;
    if lease.not_followed == 0 {
        cycle.mode = reference.mode;
        for (j, desired) in reference.joints.iter().enumerate() {
            cycle.measured.joints[j].q = desired.q_d;
            cycle.commanded.joints[j].tau_d = desired.tau_d;
        }
    }
}

fn monotonic_ns() -> Result<u64, nix::Error> {
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC)?;
    Ok(now.tv_sec() as u64 * 1_000_000_000 + now.tv_nsec() as u64)
}

/// An operator's request: the state that follows, or why there is none.
fn operate(asked: &Request, record: &mut SharedRecord) -> Result<RobotState, String> {
    let state = RobotState::from_number(record.cycle.state).unwrap_or_default();
    let time_out = Event::EnableTimeOut.number();
    match (asked.kind, state) {
        (request::ACKNOWLEDGE, RobotState::Fault) if asked.fault == time_out => {
            record.cycle.fault = 0;
            Ok(RobotState::Ready)
        }
        (request::ACKNOWLEDGE, RobotState::Fault) => {
            Err(format!("fault {time_out} is latched, not {}", asked.fault))
        }
        (request::ACKNOWLEDGE, _) => Err("no fault is latched".to_owned()),
        (_, RobotState::Fault) => Err("acknowledge the fault first".to_owned()),
        (request::DISABLE, _) => Ok(RobotState::Ready),
        (request::ENABLE, RobotState::Holding) => {
            record.cycle.fault = time_out;
            Ok(RobotState::Fault)
        }
        (request::STOP, RobotState::Ready) => Ok(RobotState::Ready),
        _ => Ok(RobotState::Holding),
    }
}

/// Answers at once; a daemon would take a second.
fn answer(
    ports: &DaemonPorts,
    asked: &Request,
    record: &mut SharedRecord,
) -> Result<(), Box<dyn Error>> {
    let mut answer = Answer {
        id: asked.id,
        ft_count: 1,
        contact_set: asked.contact_set,
        ..Answer::default()
    };
    let set = CONTACTS
        .iter()
        .position(|c| *c == asked.contact_set.as_str());
    match (asked.kind, set) {
        (request::ENABLE..=request::ACKNOWLEDGE, _) => match operate(asked, record) {
            Ok(state) => {
                record.cycle.state = state.number();
                answer.status = answer_status::DONE;
                answer.text = Text::new(state.name());
            }
            Err(why) => {
                answer.status = answer_status::REFUSED;
                answer.text = Text::new(&why);
            }
        },
        (request::TARE, Some(0)) => {
            for step in 1..4 {
                (answer.status, answer.progress) = (answer_status::WORKING, 0.25 * f64::from(step));
                ports.answer(&answer)?;
            }
            answer.date_unix_s = 1_700_000_000.0;
            answer.ft[0].known = 0b11_1111;
            answer.ft[0].offset = Wrench {
                force: [1.0, 2.0, 3.0],
                torque: [4.0, 5.0, 6.0],
            };
            answer.status = answer_status::DONE;
        }
        (request::CHOOSE_CONTACT_SET, Some(set)) => {
            let estimated = &mut record.cycle.estimated;
            (estimated.contact_set, estimated.contact_set_automatic) = (set as u32, 0);
            answer.status = answer_status::DONE;
        }
        (request::AUTOMATIC_CONTACT_SET, _) => {
            record.cycle.estimated.contact_set_automatic = 1;
            answer.status = answer_status::DONE;
        }
        _ => {
            answer.status = answer_status::REFUSED;
            let text = format!("no {}; allowed: {}", asked.contact_set, CONTACTS.join(", "));
            answer.text = Text::new(&text);
        }
    }
    ports.answer(&answer)?;
    Ok(())
}
