//! Refusals beyond those that `torquectl check` is tested with.

use crate::files::{Files, HUMANOID, LEG, leg_with, refused};
use robot_config::{Sampled, slots};

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
fn a_reference_may_be_as_old_as_two_periods_to_a_second() {
    let key = "reference_timeout_ms = 40.0";
    for ms in ["0", "-40", "1.9", "1000.1", "1e300", "nan", "inf"] {
        let faulty = format!("reference_timeout_ms = {ms}");
        let files = leg_with(key, &faulty);
        refused(
            &files,
            LEG,
            &faulty,
            &[
                "loop.reference_timeout_ms: ",
                "allowed: a number from 2 to 1000",
            ],
        );
    }
    for (line, timeout) in [
        ("reference_timeout_ms = 2", 0.002),
        ("reference_timeout_ms = 1000", 1.0),
        ("", 0.04),
    ] {
        let robot = leg_with(key, line).load(LEG);
        let robot = robot.unwrap_or_else(|error| panic!("{line}: {error}"));
        let read = robot.parameters.timing.reference_timeout;
        assert!((read - timeout).abs() < 1e-12, "{line}: {read}");
    }
}

/// Lasting errors of an F/T sensor: in the units of the keys, by default from a sample's noise.
#[test]
fn errors_of_ft_sensors_that_last_are_read_and_refused() {
    let sensor = "name = \"ankle\"\n";
    let with = |keys: &str| leg_with(sensor, &format!("{sensor}{keys}\n"));
    for (keys, parts) in [
        (
            "reading_sigma_per_cent = 101",
            ["ft_sensor.reading_sigma_per_cent (ankle): 101", "0 to 100"],
        ),
        (
            "offset_sigma_N = -1",
            ["ft_sensor.offset_sigma_N (ankle): -1", "allowed"],
        ),
    ] {
        refused(&with(keys), LEG, keys, &parts);
    }
    let given = "offset_sigma_N = 2\noffset_sigma_Nm = 0.5\nreading_sigma_per_cent = 3";
    for (keys, expected) in [(given, [2.0, 0.5, 0.03]), ("", [0.03, 0.002, 0.002])] {
        let robot = with(keys).load(LEG);
        let robot = robot.unwrap_or_else(|error| panic!("{keys}: {error}"));
        let lasting = robot.parameters.ft_sensors[0].sensor.lasting;
        let read = [lasting.force, lasting.torque, lasting.share];
        let apart = read.iter().zip(expected).map(|(a, b)| (a - b).abs());
        assert!(apart.fold(0.0, f64::max) < 1e-12, "{keys}: {read:?}");
    }
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
fn detection_of_contacts_is_judged() {
    let humanoid = |from: &str, to: &str| Files::new().with(HUMANOID, from, to);
    let with = |keys: &str| {
        humanoid(
            "[external_torque]\n",
            &format!("[external_torque]\n{keys}\n"),
        )
    };
    let with_reaction = |keys: &str| with(&format!("[external_torque.reaction]\n{keys}"));
    for (keys, parts) in [
        ("window = 3", ["external_torque.window", "5 to 100"]),
        (
            "upper_ratio = 0.9",
            ["external_torque.upper_ratio", "1 to 20"],
        ),
        ("sigmas = 0.0", ["external_torque.sigmas", "1 to 20"]),
        (
            "change_per_cent = 101.0",
            ["external_torque.change_per_cent", "0 to 100"],
        ),
        (
            "threshold_per_cent = 10.0",
            ["unknown key", "velocity_per_cent"],
        ),
        (
            "frame = \"base_link\"",
            ["\"base_link\" is no link that joints move", "a link"],
        ),
        (
            "frame = \"left_paw\"",
            ["\"left_paw\" is no link that joints move", "a link"],
        ),
    ] {
        refused(&with(keys), HUMANOID, keys, &parts);
    }
    for (keys, parts) in [
        ("comply_deg = 200.0", ["comply_deg", "0.1 to 180"]),
        (
            "gone_ms = 100.0",
            ["does not end with the contact", "contact_gone"],
        ),
    ] {
        refused(&with_reaction(keys), HUMANOID, keys, &parts);
    }
    let keys = "[external_torque.reaction]\ncomply_ends = \"contact_gone\"\ngone_ms = 100.0";
    let robot = with(keys).load(HUMANOID).unwrap();
    let settings = robot.parameters.external_torque.unwrap();
    assert_eq!(settings.reaction.comply_until_gone, Some(0.1));
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

/// The humanoid with a second IMU in this link.
fn with_second_imu(link: &str) -> Files {
    const DBC: &str = "robot-models/humanoid/drives.dbc";
    let files = Files::new();
    let dbc = files.text(DBC).to_owned();
    let from = dbc.find("BO_ 401 IMU").expect("a message");
    let end = from + dbc[from..].find("\n\n").expect("its end");
    let copy = dbc[from..end].replace("BO_ 401 IMU", "BO_ 402 IMU_2");
    let toml = files.text(HUMANOID).to_owned();
    let (before, one) = toml.split_once("[imu]").expect("an IMU");
    let second = one
        .replace("IMU.", "IMU_2.")
        .replace("\"imu_link\"", &format!("{link:?}"));
    let list = format!("{before}[[imu]]{one}\n[[imu]]{second}");
    files
        .with(DBC, &dbc[..end], &format!("{}\n\n{copy}", &dbc[..end]))
        .with(HUMANOID, &toml, &list)
}

#[test]
fn each_imu_has_a_link_of_its_own() {
    let parts = ["imu.frame (2): ", "the URDF has no link tail"];
    refused(&with_second_imu("tail"), HUMANOID, "\"tail\"", &parts);
    let text = with_second_imu("imu_link").errors(HUMANOID);
    let wanted = "imu.frame (2): a second IMU measures in this frame";
    assert!(text.contains(wanted), "{text}");
    let limit = with_second_imu("base_link").with(
        HUMANOID,
        "\"base_link\"\nbus = \"b\"\ngyro",
        "\"base_link\"\ndisagreement_m_per_s2 = 0.0\nbus = \"b\"\ngyro",
    );
    let parts = ["imu.disagreement_m_per_s2 (2): ", "allowed: "];
    refused(&limit, HUMANOID, "disagreement_m_per_s2", &parts);
}
