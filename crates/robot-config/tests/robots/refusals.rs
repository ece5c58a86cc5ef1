//! Refusals beyond those that `torquectl check` is tested with, and drives that take currents.

use crate::files::Files;
use control::MotorModel;
use robot_config::{Sampled, slots};
use robot_state::{Event, Reaction};
use supervisor::Actuation;

const LEG: &str = "config/leg/robot.toml";
const HUMANOID: &str = "config/humanoid/robot.toml";

/// The only problem is on the line of `at` in the file at `path`, and its text has all `parts`.
#[track_caller]
fn refused(files: &Files, path: &str, at: &str, parts: &[&str]) {
    let text = files.errors(path);
    assert_eq!(text.lines().count(), 1, "{text}");
    let place = format!("{path}:{}: ", files.line(path, at));
    assert!(text.starts_with(&place), "{place} does not begin\n{text}");
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in\n{text}");
    }
}

fn leg_with(from: &str, to: &str) -> Files {
    Files::new().with(LEG, from, to)
}

#[test]
fn units_must_suit_the_quantity() {
    let files = leg_with("\"KNEE_STATE.current\"", "\"KNEE_STATE.motor_angle\"");
    let text = files.errors(LEG);
    assert!(text.contains("joint.current.signal (knee)"), "{text}");
    assert!(
        text.contains("unit \"count\" is not allowed; allowed: A, mA"),
        "{text}"
    );
    let counts = leg_with("motor_counts_per_turn = 4096\n", "");
    let text = counts.errors(LEG);
    assert!(
        text.contains("count with motor_counts_per_turn of the drive"),
        "{text}"
    );
}

#[test]
fn encoders_that_lose_count_are_refused() {
    // 16 turns of 100 : 1 in a cycle of 1 ms.
    let fast = leg_with(
        "max_velocity_rad_per_s = 4.5",
        "max_velocity_rad_per_s = 900.0",
    );
    let text = fast.errors(LEG);
    assert!(
        text.contains("joint.motor_angle (hip_pitch): the signal starts again after"),
        "{text}"
    );
    let narrow = leg_with(
        "link_counts_per_turn = 524288",
        "link_counts_per_turn = 2097152",
    );
    let text = narrow.errors(LEG);
    assert!(
        text.contains("joint.link_angle (knee): the signal starts again after 90.000 deg"),
        "{text}"
    );
}

#[test]
fn position_limits_lie_within_the_urdf() {
    let files = leg_with(
        "drive = \"knee\"",
        "drive = \"knee\"\nposition_max_deg = 151.0",
    );
    let parts = [
        "joint.position_max_deg (knee): 151",
        "allowed: 0.000 to 150.000",
        "URDF",
    ];
    refused(&files, LEG, "position_max_deg = 151.0", &parts);
    let files = leg_with(
        "drive = \"knee\"",
        "drive = \"knee\"\nposition_min_deg = 30.0\nposition_max_deg = 20.0",
    );
    refused(
        &files,
        LEG,
        "position_max_deg",
        &["is not above position_min_deg"],
    );
}

#[test]
fn long_filters_need_one_delay() {
    let files = leg_with("sensor = { window = 80", "sensor = { window = 30");
    refused(&files, LEG, "[filters]", &["windows of 80 and 30 samples"]);
    let files = leg_with(
        "encoder = { window = 80, order = 2",
        "encoder = { window = 80, order = 1",
    );
    refused(
        &files,
        LEG,
        "encoder = ",
        &["filters.encoder.order: 1", "from 2 to 5"],
    );
}

#[test]
fn sync_must_be_a_message() {
    let files = leg_with(
        "interface = \"vcan1\"\ndbc",
        "interface = \"vcan1\"\nsync = \"SINK\"\ndbc",
    )
    .with(
        LEG,
        "dbc = \"../../robot-models/leg/drives.dbc\"\nsync = \"SYNC\"\nfd = false\n\n[f",
        "dbc = \"../../robot-models/leg/drives.dbc\"\nfd = false\n\n[f",
    );
    refused(
        &files,
        LEG,
        "sync = \"SINK\"",
        &[
            "bus.sync (b)",
            "no DBC file of the bus has a message SINK",
            "SYNC",
        ],
    );
}

#[test]
fn names_must_fit_into_a_record() {
    refused(
        &leg_with("name = \"leg\"", "name = \"le g\""),
        LEG,
        "name = ",
        &["1 to 48 letters"],
    );
    let twice = leg_with("name = \"b\"", "name = \"a\"");
    assert!(twice.errors(LEG).contains("a second bus has this name"));
}

#[test]
fn sensors_must_be_where_the_estimator_can_use_them() {
    let files = leg_with("frame = \"ankle_ft\"", "frame = \"no_link\"");
    let parts = [
        "ft_sensor.frame: the URDF has no link no_link",
        "allowed: ",
        "ankle_ft",
    ];
    refused(&files, LEG, "frame = \"no_link\"", &parts);
    let files = leg_with("frame = \"ankle_ft\"", "frame = \"base_link\"");
    let parts = [
        "ft_sensor.frame (ankle): ",
        "root link",
        "allowed: any other link",
    ];
    refused(&files, LEG, "frame = \"base_link\"", &parts);
    let files = leg_with("= \"base_link\"", "= \"no_link\"");
    let parts = ["whole_body.unknown_wrench_link: the URDF has no link no_link"];
    refused(&files, LEG, "unknown_wrench_link", &parts);
    let files = leg_with(
        "frame = \"ankle_ft\"",
        "frame = \"ankle_ft\"\ncontact_link = \"base_link\"",
    );
    refused(
        &files,
        LEG,
        "contact_link",
        &["ft_sensor.contact_link (ankle): ", "not beyond"],
    );
    let files = leg_with("= \"base_link\"", "= \"ankle_ft\"");
    let parts = [
        "whole_body.unknown_wrench_link: ",
        "beyond F/T sensor ankle",
    ];
    refused(&files, LEG, "unknown_wrench_link", &parts);
}

#[test]
fn a_floating_base_needs_an_imu() {
    let files = Files::new();
    let (before, _imu) = files.text(HUMANOID).split_once("[imu]").expect("an IMU");
    let without = before.to_owned();
    let whole = files.text(HUMANOID).to_owned();
    let files = files.with(HUMANOID, &whole, &without);
    refused(
        &files,
        HUMANOID,
        "base = \"floating\"",
        &["robot.base: ", "IMU", "allowed: \"fixed\""],
    );
}

#[test]
fn wrong_types_are_refused_with_the_written_value() {
    let files = leg_with("rate_hz = 1000.0", "rate_hz = \"fast\"");
    let text = files.errors(LEG);
    assert!(
        text.contains("loop.rate_hz: \"fast\" is not allowed; allowed: a number"),
        "{text}"
    );
    let files = leg_with("priority = 80", "priority = 0");
    refused(
        &files,
        LEG,
        "priority = 0",
        &["loop.priority: 0", "an integer from 1 to 99"],
    );
    let files = leg_with("fd = false\n\n[filters]", "fd = 1\n\n[filters]");
    refused(&files, LEG, "fd = 1", &["bus.fd (b): 1", "true or false"]);
    let files = leg_with("sign = 1\n", "sign = 2\n");
    refused(
        &files,
        LEG,
        "sign = 2",
        &["ft_sensor.sign (ankle): 2", "1 or -1"],
    );
}

#[test]
fn gains_may_be_given_in_the_commanded_position() {
    let same = leg_with(
        "K_s_Nm_per_rad = 4167.0, K_d_Nms_per_rad = 41.7",
        "K6 = 1.00008, K7_s = 0.010008",
    );
    let gains = same
        .load(LEG)
        .unwrap_or_else(|e| panic!("{e}"))
        .parameters
        .joints[2]
        .gains;
    assert!((gains.k_s - 8334.0).abs() < 1e-6, "{}", gains.k_s);
    assert!((gains.k_d - 83.4).abs() < 1e-8, "{}", gains.k_d);
    let both = leg_with(
        "K_s_Nm_per_rad = 4167.0",
        "K6 = 1.0, K7_s = 0.0, K_s_Nm_per_rad = 4167.0",
    );
    assert!(
        both.errors(LEG)
            .contains("joint.gains.K_s_Nm_per_rad (hip_pitch): unknown key")
    );
}

/// The leg with one joint on a current-commanded drive.
fn with_current_drive(limit: &str) -> Files {
    let motor = "K_tau_rad_per_Nm = 0.000212  # = 1/K_fs0 + 1/(7403 N·m/rad of the drive's position loop)\nK_v_s = 0.013\nK_c_rad = 0.0\ndead_zone_rad = 0.000113  # 3 % of rated torque\n";
    Files::new()
        .with(
            LEG,
            motor,
            "K_1_Nm_per_A = 6.0\nK_2_Nms_per_rad = 12.0\nK_3_Nm = 2.5\n",
        )
        .with(
            LEG,
            "command = \"position\"\n[drive.hip_yaw.",
            &format!("command = \"current\"\n{limit}[drive.hip_yaw."),
        )
        .with(
            "robot-models/leg/drives.dbc",
            "SG_ hip_yaw_position : 0|21@1- (3e-06,0) [-3.145728|3.145725] \"rad\"",
            "SG_ hip_yaw_position : 0|21@1- (1,0) [0|0] \"mA\"",
        )
}

#[test]
fn current_drives_take_a_current() {
    let robot = with_current_drive("current_limit_A = 9.5\n").load(LEG);
    let joint = &robot.unwrap_or_else(|e| panic!("{e}")).parameters.joints[0];
    assert!(!joint.takes_position());
    let Actuation::Current { k_1, current, .. } = joint.actuation else {
        panic!("{:?}", joint.actuation);
    };
    assert_eq!([k_1, current], [6.0, 9.5]);
    assert!(
        matches!(joint.motor, MotorModel::Current { k1, k2, k3, .. } if [k1, k2, k3] == [6.0, 12.0, 2.5])
    );
    let files = with_current_drive("");
    let text = files.errors(LEG);
    assert!(
        text.contains("drive.current_limit_A (hip_yaw): the key is missing"),
        "{text}"
    );
    let files = with_current_drive("current_limit_A = 9.5\n").with(
        LEG,
        "K_s_Nm_per_rad = 2358.0, K_d_Nms_per_rad = 23.6",
        "K6 = 1.0, K7_s = 0.01",
    );
    refused(&files, LEG, "K6 = 1.0", &["takes currents, not positions"]);
}

#[test]
fn impossible_conditioning_is_refused() {
    let sensor = "name = \"ankle\"\n";
    let with = |keys: &str| leg_with(sensor, &format!("{sensor}{keys}\n"));
    let row = "[1, 0, 0, 0, 0, 0]";
    let singular = format!("calibration = [{}]", [row; 6].join(", "));
    let nan = singular.replacen('1', "nan", 1);
    for (keys, parts) in [
        (
            singular.as_str(),
            ["ft_sensor.calibration (ankle)", "with an inverse"],
        ),
        (
            &nan,
            ["ft_sensor.calibration (ankle): NaN", "a finite number"],
        ),
        (
            "calibration = [1, 2]",
            ["ft_sensor.calibration (ankle): 2 values", "6 rows"],
        ),
        (
            "calibration = [1, 2, 3, 4, 5, 6]",
            ["ft_sensor.calibration (ankle): 1 is not", "6 rows"],
        ),
        (
            "temperature_gain_per_K = [1, 1, 1, 1, 1, 1]",
            ["has no key temperature", "or neither"],
        ),
        (
            "temperature = \"ANKLE_FT_F.fx\"\nreference_temperature_C = 20",
            ["signal ANKLE_FT_F.fx: unit \"N\" is not allowed", "degC"],
        ),
        (
            "temperature = \"ANKLE_FT_F.warmth\"",
            [
                "reference_temperature_C (ankle): the key is missing",
                "a number from -273.15",
            ],
        ),
    ] {
        let text = with(keys).errors(LEG);
        for part in parts {
            assert!(text.contains(part), "{part} is missing in: {text}");
        }
    }
}

#[test]
fn contacts_must_cover_every_part() {
    let humanoid = |from: &str, to: &str| Files::new().with(HUMANOID, from, to);
    let files = humanoid(
        "  { link = \"left_hand\", type = \"none\" },\n  { link = \"right_hand\", type = \"none\" },\n  \
         { link = \"chest_pitch_link\", type = \"full_wrench\" },\n]\n\n[[contacts]]\nname = \"on_left_foot\"",
        "  { link = \"right_hand\", type = \"none\" },\n  \
         { link = \"chest_pitch_link\", type = \"full_wrench\" },\n]\n\n[[contacts]]\nname = \"on_left_foot\"",
    );
    let parts = [
        "contacts.touch (standing): the part beyond F/T sensor `left_wrist`",
        "has no contact",
        "`none`",
    ];
    refused(&files, HUMANOID, "touch = [", &parts);
    let files = humanoid(
        "loaded = [\"left_ankle\"]\nunloaded = [\"right",
        "loaded = [\"left_toe\"]\nunloaded = [\"right",
    );
    let parts = [
        "contacts.loaded (on_left_foot): \"left_toe\" is no F/T sensor",
        "left_ankle, right_ankle, left_wrist, right_wrist",
    ];
    refused(&files, HUMANOID, "loaded = [\"left_toe\"]", &parts);
    let files = humanoid("name = \"unheld\"", "name = \"standing\"");
    let text = files.errors(HUMANOID);
    assert!(
        text.contains("contacts.name (standing): \"standing\""),
        "{text}"
    );
    let files = humanoid("off_N = 30.0", "off_N = 70.0");
    refused(&files, HUMANOID, "off_N = 70.0", &["off_N < on_N"]);
    let files = humanoid("[cross_check]", "[cross_chek]");
    refused(&files, HUMANOID, "[cross_chek]", &["unknown key"]);
    let files = humanoid(
        "angular_acceleration = \"differentiate\"",
        "unknown_wrench_link = \"base_link\"",
    );
    let parts = ["whole_body.unknown_wrench_link: ", "[[contacts]]"];
    refused(&files, HUMANOID, "unknown_wrench_link", &parts);
    let files = humanoid(
        "{ link = \"left_foot\", type = \"full_wrench\" }",
        "{ link = \"left_foot\", type = \"known_direction\" }",
    );
    let text = files.errors(HUMANOID);
    assert!(
        text.contains("contacts.touch.direction (standing): "),
        "{text}"
    );
}

#[test]
fn filters_are_matched_or_not() {
    let files = leg_with("sensor = { window = 80, order = 1 }", "matched = 40");
    let parts = ["filters.encoder: ", "matched, or encoder and sensor"];
    refused(&files, LEG, "encoder = { window", &parts);
    let files = leg_with("sensor = { window = 80, order = 1 }", "matched = 2");
    let text = files.errors(LEG);
    assert!(
        text.contains("filters.matched: 2 is not allowed; allowed: an integer from 3"),
        "{text}"
    );
}

#[test]
fn impossible_sampling_is_refused() {
    let drive = "gear_ratio = 100.0\n";
    let with = |keys: &str| leg_with(drive, &format!("{drive}{keys}\n"));
    let refusal = |keys: &str| with(keys).errors(LEG);
    let sometimes = refusal("sampled = \"sometimes\"");
    let choices = "is not allowed; allowed: \"at_sync\" or \"when_sent\"";
    assert!(sometimes.contains(choices), "{sometimes}");
    let late = refusal("latency_us = 16001");
    assert!(
        late.contains("allowed: a number from -16000 to 16000"),
        "{late}"
    );
    let idle = refusal("period_us = 1000");
    assert!(
        idle.contains("drive.period_us (hip_yaw): a source that is sampled at SYNC has no period"),
        "{idle}"
    );
    let robot = with("sampled = \"when_sent\"\nlatency_us = -50\nperiod_us = 2500").load(LEG);
    let robot = robot.unwrap_or_else(|e| panic!("{e}"));
    let sampling = robot.parameters.joints[0].sampling;
    assert_eq!(sampling.sampled, Sampled::WhenSent { period: 2.5e-3 });
    assert!((sampling.latency + 5e-5).abs() < 1e-12);
    // From one cycle to the next it may move for 3.5 ms.
    let reach = robot.parameters.joints[0].encoders.max_velocity;
    let synced = Files::new().load(LEG).unwrap_or_else(|e| panic!("{e}"));
    let ratio = reach / synced.parameters.joints[0].encoders.max_velocity;
    assert!((ratio - 3.5).abs() < 1e-12, "{ratio}");
    // A cycle does not wait for a drive that sends by its own clock; sensors on its bus still answer.
    let answers = robot.answers();
    for (message, answers) in answers.iter().enumerate() {
        let mut slots = robot.receive.slots(message);
        let joint = slots.any(|slot| matches!(slots::source(slot), slots::Source::Joint(_)));
        assert_eq!(*answers, !joint, "message {message}");
    }
    assert!(answers.contains(&true) && answers.contains(&false));
}

#[test]
fn a_stand_holds_what_could_move() {
    let stand = |link: &str| format!("\n[fixed_base]\nlink = \"{link}\"\n\n[whole_body]\n");
    let files = leg_with("[whole_body]\n", &stand("base_link"));
    let parts = ["fixed_base.link: base = \"fixed\" holds", "\"floating\""];
    refused(&files, LEG, "link = \"base_link\"", &parts);
    let files = leg_with("[whole_body]\n", &stand("no_link"));
    let files = files.with(LEG, "base = \"fixed\"", "base = \"floating\"");
    let parts = ["fixed_base.link: the URDF has no link no_link", "allowed: "];
    refused(&files, LEG, "link = \"no_link\"", &parts);
}

#[test]
fn drives_with_states_need_their_words() {
    let files = leg_with("status = { signal = \"KNEE_STATE.status\" }\n", "");
    let text = files.errors(LEG);
    assert!(
        text.contains("joint.status (knee): the key is missing"),
        "{text}"
    );
    let state = "[drive.knee.state]\nprofile = \"cia402\"\n";
    let files = leg_with(state, "");
    let parts = ["joint.control (knee)", "has no control words to send"];
    refused(&files, LEG, "CONTROL_B.knee_control", &parts);
    let files = leg_with(
        state,
        "[drive.knee.state]\nstatus = [{ state = \"off\", mask = 1, value = 3 }]\n",
    );
    let text = files.errors(LEG);
    for part in [
        "no status word stands for an enabled drive",
        "has bits outside the mask",
        "has no control words to send",
    ] {
        assert!(text.contains(part), "{part:?} is not in\n{text}");
    }
}

#[test]
fn control_words_share_no_message_with_set_points() {
    let files = Files::new()
        .with(LEG, "CONTROL_B.knee_control", "COMMAND_B.knee_control")
        .with(
            "robot-models/leg/drives.dbc",
            " SG_ knee_position : 0|21@1-",
            " SG_ knee_control : 63|1@1+ (1,0) [0|1] \"\" DRIVES\n SG_ knee_position : 0|21@1-",
        );
    let parts = [
        "joint.control.signal (knee): message COMMAND_B carries set-points too",
        "allowed: a message of its own for control words",
    ];
    refused(&files, LEG, "COMMAND_B.knee_control", &parts);
}

#[test]
fn a_drive_may_have_words_of_its_own_or_be_watched_only() {
    let own = "[drive.knee.state]\nstep_time_limit_ms = 20.5\n\
               status = [{ state = \"fault\", mask = 2, value = 2 }, { state = \"enabled\", mask = 1, value = 1 }]\n\
               control = { prepare = 0, switch_on = 0, enable = 1, disable = 0, reset = 2 }\n";
    let robot = leg_with("[drive.knee.state]\nprofile = \"cia402\"\n", own)
        .load(LEG)
        .unwrap();
    let profile = robot.parameters.joints[3].drive_profile.as_ref().unwrap();
    assert_eq!((profile.step_limit, profile.status.len()), (21, 2));
    assert_eq!(profile.state(3), robot_state::DriveState::Fault);
    assert_eq!(profile.control.map(|words| words.enable), Some(1));
    let control = "control = { signal = \"CONTROL_B.knee_control\" }\n";
    let robot = leg_with(control, "").load(LEG).unwrap();
    let profile = robot.parameters.joints[3].drive_profile.as_ref().unwrap();
    assert_eq!(profile.control, None);
}

#[test]
fn reactions_are_never_weaker_than_the_least_one() {
    let with = |reactions: &str| {
        let text = format!("[safety]\nenable = \"automatic\"\n[safety.reactions]\n{reactions}\n");
        leg_with(
            "[safety]\nenable = \"automatic\"  # a simulated robot; \"operator\" on a real one\nlate_per_cent = 100   # the same: late cycles do no harm\n",
            &text,
        )
    };
    for (reaction, parts) in [
        (
            "joint_stale = \"warn\"",
            [
                "\"warn\" is not allowed for event 104",
                "allowed: hold, stop, off",
            ],
        ),
        (
            "late_cycle = \"degrade\"",
            [
                "\"degrade\" is not allowed",
                "warn, release, hold, stop, off",
            ],
        ),
        (
            "external_contact = \"comply\"",
            [
                "\"comply\" is not allowed for event 209",
                "warn, release, hold",
            ],
        ),
        (
            "ft_drift = 3",
            [
                "safety.reactions.ft_drift: 3 is not allowed",
                "warn, degrade, release",
            ],
        ),
        ("no_such = \"stop\"", ["unknown key", "joint_stale"]),
    ] {
        refused(&with(reaction), LEG, reaction, &parts);
    }
    let leg = with("joint_stale = \"off\"\nft_drift = \"degrade\"")
        .load(LEG)
        .unwrap();
    let reactions = leg.parameters.safety.reactions;
    assert_eq!(reactions.of(Event::JointStale), Reaction::Off);
    assert_eq!(reactions.of(Event::FtDrift), Reaction::Degrade);
    assert_eq!(reactions.of(Event::EncoderSlip), Reaction::Warn);
}
