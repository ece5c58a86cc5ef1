//! The robot's states under any course of requests, faults and joints that come and go.

use proptest::prelude::*;
use robot_state::{Event, RobotState};
use supervisor::{JointCondition, OperatorRequest, Refusal, RobotMachine, Safety};

const JOINTS: usize = 3;
const TIME_LIMIT: u32 = 20;
const GOOD: JointCondition = JointCondition {
    usable: true,
    stale: false,
    distrusted: false,
    slipped: false,
    inside: true,
    drive_enabled: true,
    drive_fault: false,
    at_rest: true,
    unfit: false,
};

fn engaged(machine: &RobotMachine) -> usize {
    (0..JOINTS).filter(|&j| machine.is_engaged(j)).count()
}

/// A robot that an operator has enabled.
fn holding() -> RobotMachine {
    let mut machine = RobotMachine::new(JOINTS, false, TIME_LIMIT);
    machine.update(&[GOOD; JOINTS]);
    machine
        .request(OperatorRequest::Enable, &[GOOD; JOINTS])
        .unwrap();
    // Every drive has to follow for a while.
    machine.update(&[GOOD; JOINTS]);
    assert_eq!(machine.state(), RobotState::Enabling);
    (0..30).for_each(|_| _ = machine.update(&[GOOD; JOINTS]));
    assert_eq!(machine.state(), RobotState::Holding);
    machine
}

#[test]
fn nothing_is_engaged_before_an_operator_enables() {
    let mut machine = RobotMachine::new(JOINTS, false, TIME_LIMIT);
    for _ in 0..100 {
        machine.update(&[JointCondition::default(); JOINTS]);
        assert_eq!(machine.state(), RobotState::Boot);
    }
    let refused = machine.request(OperatorRequest::Enable, &[GOOD; JOINTS]);
    assert_eq!(refused, Err(Refusal::State(RobotState::Boot)));
    for _ in 0..100 {
        machine.update(&[GOOD; JOINTS]);
        assert_eq!((machine.state(), engaged(&machine)), (RobotState::Ready, 0));
    }
    let mut outside = [GOOD; JOINTS];
    outside[1].inside = false;
    let refused = machine.request(OperatorRequest::Enable, &outside);
    assert_eq!(refused, Err(Refusal::Outside(1)));
    assert_eq!(engaged(&machine), 0);
}

#[test]
fn a_drive_that_does_not_answer_ends_in_a_time_out() {
    let mut machine = RobotMachine::new(JOINTS, true, TIME_LIMIT);
    let mut joints = [GOOD; JOINTS];
    joints[2].drive_enabled = false;
    let mut events = (0..2 * TIME_LIMIT).filter_map(|_| machine.update(&joints));
    assert_eq!(events.next(), Some((Event::EnableTimeOut, Some(2))));
}

#[test]
fn a_stale_joint_is_withdrawn_until_it_is_enabled_again() {
    let mut machine = holding();
    let mut joints = [GOOD; JOINTS];
    joints[0] = JointCondition {
        usable: false,
        stale: true,
        ..GOOD
    };
    assert_eq!(machine.update(&joints), Some((Event::JointStale, Some(0))));
    machine.latch(Event::JointStale, Safety::Hold);
    assert_eq!((engaged(&machine), machine.is_engaged(0)), (2, false));
    for _ in 0..10 {
        machine.update(&[GOOD; JOINTS]);
        assert!(
            !machine.is_engaged(0),
            "back on the bus is not back in control"
        );
    }
    let other = machine.request(OperatorRequest::Acknowledge(999), &[GOOD; JOINTS]);
    assert_eq!(other, Err(Refusal::OtherFault(Event::JointStale.number())));
    let this = OperatorRequest::Acknowledge(Event::JointStale.number());
    machine.request(this, &[GOOD; JOINTS]).unwrap();
    machine.update(&[GOOD; JOINTS]);
    assert_eq!(
        (machine.state(), machine.is_engaged(0)),
        (RobotState::Ready, false)
    );
    machine
        .request(OperatorRequest::Enable, &[GOOD; JOINTS])
        .unwrap();
    (0..30).for_each(|_| _ = machine.update(&[GOOD; JOINTS]));
    assert_eq!(
        (machine.state(), engaged(&machine)),
        (RobotState::Holding, JOINTS)
    );
}

#[test]
fn the_first_fault_is_shown_and_the_strongest_reaction_holds() {
    let mut machine = holding();
    machine.set_active(true);
    machine.latch(Event::CommandNotFinite, Safety::Hold);
    machine.latch(Event::JointStale, Safety::Off);
    machine.latch(Event::EnableTimeOut, Safety::Hold);
    assert_eq!(machine.fault(), Some(Event::CommandNotFinite));
    assert_eq!(engaged(&machine), 0);
    machine.set_active(true);
    assert_eq!(machine.state(), RobotState::Fault);
}

#[test]
fn a_drive_that_is_no_longer_enabled_loses_its_set_points_and_others_are_held() {
    let mut machine = holding();
    let mut joints = [GOOD; JOINTS];
    joints[1].drive_enabled = false;
    joints[1].drive_fault = true;
    let (lost, joint) = machine.update(&joints).unwrap();
    assert_eq!((lost, joint), (Event::DriveLost, Some(1)));
    machine.latch(lost, Safety::Hold);
    assert!(!machine.is_engaged(1));
    assert_eq!(engaged(&machine), JOINTS - 1);
    let acknowledge = OperatorRequest::Acknowledge(lost.number());
    assert_eq!(machine.request(acknowledge, &joints), Ok(()));
    assert_eq!(machine.state(), RobotState::Ready);
    let refused = machine.request(OperatorRequest::Enable, &joints);
    assert_eq!(refused, Err(Refusal::Drive(1)));
    joints[1].drive_fault = false;
    assert_eq!(machine.request(OperatorRequest::Enable, &joints), Ok(()));
    assert!(machine.wants_drive(1));
}

#[test]
fn an_encoder_that_slips_while_the_drives_are_off_is_a_fault_that_one_acknowledgement_ends() {
    let mut machine = RobotMachine::new(JOINTS, false, TIME_LIMIT);
    machine.update(&[GOOD; JOINTS]);
    let mut joints = [GOOD; JOINTS];
    joints[2] = JointCondition {
        usable: false,
        distrusted: true,
        slipped: true,
        ..GOOD
    };
    assert_eq!(
        machine.update(&joints),
        Some((Event::EncoderImplausible, Some(2)))
    );
    machine.latch(Event::EncoderImplausible, Safety::Hold);
    let acknowledge = OperatorRequest::Acknowledge(Event::EncoderImplausible.number());
    assert_eq!(machine.request(acknowledge, &joints), Ok(()));
    // It proves itself anew.
    (joints[2].distrusted, joints[2].slipped) = (false, false);
    assert_eq!(machine.update(&joints), None);
    assert_eq!(machine.state(), RobotState::Boot);
}

#[test]
fn a_joint_that_proves_itself_anew_is_held_and_no_client_is_followed() {
    let mut machine = holding();
    let mut joints = [GOOD; JOINTS];
    (joints[1].usable, joints[1].distrusted) = (false, true);
    assert_eq!(
        machine.update(&joints),
        Some((Event::EncoderImplausible, Some(1)))
    );
    machine.latch(Event::EncoderImplausible, Safety::Hold);
    let acknowledge = OperatorRequest::Acknowledge(Event::EncoderImplausible.number());
    assert_eq!(machine.request(acknowledge, &joints), Ok(()));
    joints[1].distrusted = false;
    assert_eq!(machine.update(&joints), None);
    assert_eq!(
        (machine.state(), engaged(&machine)),
        (RobotState::Holding, JOINTS)
    );
    assert!(!machine.may_follow());
    machine.update(&[GOOD; JOINTS]);
    assert!(machine.may_follow());
}

#[derive(Debug, Clone)]
enum Action {
    Request(OperatorRequest),
    Latch(Safety),
    Active(bool),
    Cycle([JointCondition; JOINTS]),
}

fn any_condition() -> impl Strategy<Value = JointCondition> {
    let conditions = any::<[bool; 6]>().prop_map(
        |[usable, stale, inside, drive_enabled, drive_fault, at_rest]| JointCondition {
            usable: usable && !stale,
            stale,
            inside,
            drive_enabled,
            drive_fault,
            at_rest,
            ..JointCondition::default()
        },
    );
    (conditions, any::<[bool; 2]>()).prop_map(|(condition, [distrusted, slipped])| JointCondition {
        usable: condition.usable && !distrusted && !slipped,
        distrusted: distrusted || slipped,
        slipped,
        ..condition
    })
}

fn any_action() -> impl Strategy<Value = Action> {
    let safety = prop::sample::select(vec![Safety::Hold, Safety::Stop, Safety::Off]);
    let request = prop_oneof![
        Just(OperatorRequest::Enable),
        Just(OperatorRequest::Disable),
        Just(OperatorRequest::Stop),
        prop::sample::select(Event::ALL).prop_map(|e| OperatorRequest::Acknowledge(e.number())),
    ];
    prop_oneof![
        2 => request.prop_map(Action::Request),
        1 => safety.prop_map(Action::Latch),
        1 => any::<bool>().prop_map(Action::Active),
        3 => prop::array::uniform3(any_condition()).prop_map(Action::Cycle),
        3 => Just(Action::Cycle([GOOD; JOINTS])),
    ]
}

proptest! {
    #[test]
    fn engaging_takes_an_operator_and_holding_can_always_be_reached(
        actions in prop::collection::vec(any_action(), 0..60),
    ) {
        let mut machine = RobotMachine::new(JOINTS, false, TIME_LIMIT);
        let mut joints = [JointCondition::default(); JOINTS];
        for action in actions {
            let (before, engaged_before) = (machine.state(), engaged(&machine));
            match action {
                Action::Request(request) => _ = machine.request(request, &joints),
                Action::Latch(safety) => machine.latch(Event::CommandNotFinite, safety),
                Action::Active(active) => machine.set_active(active),
                Action::Cycle(conditions) => {
                    joints = conditions;
                    if let Some((event, _)) = machine.update(&joints) {
                        machine.latch(event, Safety::Hold);
                    }
                }
            }
            if engaged(&machine) > engaged_before {
                prop_assert_eq!(before, RobotState::Enabling);
            }
            if matches!(machine.state(), RobotState::Boot) {
                prop_assert_eq!(engaged(&machine), 0);
            }
            if before == RobotState::Fault && machine.state() != RobotState::Fault {
                prop_assert!(matches!(machine.state(), RobotState::Ready | RobotState::Holding));
            }
            if machine.state() == RobotState::Active {
                prop_assert!(matches!(before, RobotState::Holding | RobotState::Active));
            }
            prop_assert_eq!(machine.fault().is_some(), machine.state() == RobotState::Fault);
        }
        // The operator's way back, with everything in order again.
        if let Some(fault) = machine.fault() {
            let request = OperatorRequest::Acknowledge(fault.number());
            prop_assert_eq!(machine.request(request, &[GOOD; JOINTS]), Ok(()));
        }
        for _ in 0..TIME_LIMIT + 2 {
            machine.update(&[GOOD; JOINTS]);
        }
        prop_assert_eq!(machine.request(OperatorRequest::Enable, &[GOOD; JOINTS]), Ok(()));
        for _ in 0..TIME_LIMIT + 30 {
            prop_assert_eq!(machine.update(&[GOOD; JOINTS]), None);
        }
        machine.set_active(false);
        prop_assert_eq!((machine.state(), engaged(&machine)), (RobotState::Holding, JOINTS));
    }
}
