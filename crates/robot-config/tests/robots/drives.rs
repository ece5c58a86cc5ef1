//! Drives: what they are commanded by, their states, and the reactions to their faults.

use crate::files::{Files, LEG, leg_with, refused};
use control::DriveModel;
use robot_state::{Event, Reaction};

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

/// sigma = F_c / presliding, both link side; without the key 1.2 times the gear's.
#[test]
fn the_way_over_which_friction_builds_up_is_the_laws() {
    let friction = |files: Files| {
        let robot = files.load(LEG).unwrap_or_else(|e| panic!("{e}"));
        robot.parameters.joints[2].law.friction
    };
    let unknown = friction(Files::new());
    let key = "[drive.hip_pitch.friction]    # motor side\n";
    let with = |way: &str| leg_with(key, &format!("{key}presliding_rad = {way}\n"));
    let known = friction(with("0.004"));
    assert_eq!(known.level, unknown.level);
    let way = known.level / known.stiffness;
    assert!((way - 0.004 / 100.0).abs() < 1e-12, "{way}");
    assert!((known.stiffness / unknown.stiffness - 1.0).abs() > 0.1);
    let text = with("0.0").errors(LEG);
    assert!(text.contains("friction.presliding_rad"), "{text}");
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
    let DriveModel::Current(drive) = joint.drive_model else {
        panic!("{:?}", joint.drive_model);
    };
    let numbers = [drive.k_1, drive.k_2, drive.k_3, drive.current_limit];
    assert_eq!(numbers, [6.0, 12.0, 2.5, 9.5]);
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
    let set =
        "[drive.knee.state]\nprofile = \"cia402\"\ntime_out_set = { mask = 0x80, value = 0 }\n";
    let robot = leg_with("[drive.knee.state]\nprofile = \"cia402\"\n", set)
        .load(LEG)
        .unwrap();
    let profile = robot.parameters.joints[3].drive_profile.as_ref().unwrap();
    let bits = profile.time_out_set.map(|bits| (bits.mask, bits.value));
    assert_eq!((profile.is_cia402(), bits), (true, Some((0x80, 0))));
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
                "nothing detects the contact to which \"comply\" reacts",
                "a table [external_torque]",
            ],
        ),
        (
            "overspeed = \"retract\"",
            [
                "\"retract\" is not allowed for event 409",
                "hold, stop, off",
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

#[test]
fn a_joint_moves_no_faster_than_the_urdf_allows_and_needs_limits_there() {
    let urdf = "robot-models/leg/robot.urdf";
    let knee = "effort=\"233\" velocity=\"4\"/>\n  </joint>\n  <link name=\"knee_link\">";
    let with = |limits: &str| {
        let given = knee.replace("effort=\"233\" velocity=\"4\"", limits);
        Files::new().with(urdf, knee, &given)
    };
    let slow = with("effort=\"233\" velocity=\"1.5\"");
    let robot = slow.load(LEG).unwrap();
    assert_eq!(robot.parameters.joints[3].limits.velocity, 1.5);
    let faster = "drive = \"knee\"\nvelocity_limit_rad_per_s = 3.0";
    let faster = slow.with(LEG, "drive = \"knee\"", faster);
    let parts = ["joint.velocity_limit_rad_per_s (knee)", "URDF's 1.5 rad/s"];
    refused(&faster, LEG, "velocity_limit_rad_per_s = 3.0", &parts);
    // As some programs write them.
    let text = with("effort=\"0\" velocity=\"0\"").errors(LEG);
    for part in [
        "joint.torque_limit_Nm (knee): the URDF's effort is 0; allowed: a <limit> whose effort is above 0",
        "joint.velocity_limit_rad_per_s (knee): the URDF's velocity is 0",
    ] {
        assert!(text.contains(part), "{text}");
    }
}
