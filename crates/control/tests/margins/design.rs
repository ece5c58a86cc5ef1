//! The design that margins choose.

use control::margins::{JointLoop, Load, NEEDED, choose_design, least_margins};
use control::predictive::{Design, DriveLoop};

use crate::{JOINTS, Law, growth, joint, predictive};

/// Drives and gears of other proportions than those for which the default design was found: a gear half as
/// stiff, a drive three times as stiff, a rotor of twice the inertia.
fn other_proportions() -> Vec<JointLoop> {
    let factors = [[1.0, 0.5, 1.0], [1.0, 1.0, 3.0], [2.0, 1.0, 1.0]];
    let scaled = |[rotor, gear, drive]: [f64; 3]| {
        JOINTS.map(|[j, k, k_d, d_d, link]| {
            // The drive's own damping ratio stays.
            let damping = d_d * (drive * rotor).sqrt();
            joint([j * rotor, k * gear, k_d * drive, damping, link])
        })
    };
    factors.into_iter().flat_map(scaled).collect()
}

/// The joint with the default design, that helps a hand.
fn helping(numbers: [f64; 5]) -> JointLoop {
    let mut of_joint = joint(numbers);
    of_joint.law.design = Design::default();
    of_joint
}

/// The margins must not hang on a damping that no data sheet has. With help for a hand no margins are known: the loop
/// comes to rest with twice the torque of the motor, and with a command that is a millisecond late.
#[test]
fn design_helps_a_hand_and_keeps_the_margins_with_another_damping() {
    for mut of_joint in JOINTS.map(helping) {
        let default = Design::default();
        let chosen = choose_design(&of_joint, &NEEDED, f64::INFINITY);
        let linear = Design {
            assist: default.assist,
            assist_bandwidth: default.assist_bandwidth,
            ..chosen
        };
        assert_eq!(linear, default, "{of_joint:?}");
        assert!(chosen.assist >= default.assist, "{chosen:?}");
        of_joint.law.design = chosen;
        for share in [0.8, 1.0, 1.2] {
            let mut with = of_joint;
            if let DriveLoop::Position { damping, .. } = &mut with.truth.drive {
                *damping *= share;
            }
            let least = least_margins(&with, &Load::ALL).0;
            assert!(least.keeps(&NEEDED), "{share}: {least:?}");
            let grows = |load: Load, gain: f64, late: bool| {
                let laws = [late_by_a_cycle(&with, late), late_by_a_cycle(&with, late)];
                growth(
                    (with.truth, with.link_inertia),
                    laws,
                    load,
                    [gain, 0.0],
                    1500,
                ) > 1.0
            };
            for load in [Load::Free, Load::Light, Load::Heavy, Load::Spring] {
                assert!(
                    !grows(load, NEEDED.gain, false),
                    "{load:?} {share}: {with:?}"
                );
                assert!(!grows(load, 1.0, true), "{load:?} {share}: {with:?}");
            }
        }
    }
}

/// The law, with commands that are a cycle later than it knows.
fn late_by_a_cycle(of_joint: &JointLoop, late: bool) -> Law<'_> {
    let mut law = predictive(of_joint);
    let mut last = 0.0;
    Box::new(move |theta, q| {
        let command = law(theta, q);
        if late {
            std::mem::replace(&mut last, command)
        } else {
            command
        }
    })
}

/// A joint whose loop rings with help for a hand has none: here one whose drive is a thousand times what help may
/// multiply.
#[test]
fn design_that_rings_with_help_has_none() {
    let mut of_joint = helping(JOINTS[0]);
    of_joint.law.design.assist = 1000.0;
    of_joint.law.design.assist_bandwidth = 1000.0;
    let chosen = choose_design(&of_joint, &NEEDED, f64::INFINITY);
    assert_eq!(chosen.assist, 0.0);
    let rest = Design {
        assist: of_joint.law.design.assist,
        ..chosen
    };
    assert_eq!(rest, of_joint.law.design);
}

#[test]
fn design_is_chosen_for_drives_and_gears_of_other_proportions() {
    let keeps = |of_joint: &JointLoop| least_margins(of_joint, &Load::ALL).0.keeps(&NEEDED);
    let all = other_proportions();
    let by_default = all.iter().filter(|of_joint| keeps(of_joint)).count();
    let mut chosen = 0;
    for of_joint in &all {
        let mut with = *of_joint;
        with.law.design = choose_design(of_joint, &NEEDED, f64::INFINITY);
        chosen += usize::from(keeps(&with));
        assert!(keeps(&with) || !keeps(of_joint), "{of_joint:?}");
        let changed = with.law.design != of_joint.law.design;
        assert!(keeps(&with) || !changed, "{of_joint:?}");
        if changed {
            // A third of the default's bandwidth is left at least, with the rotor stuck.
            let [before, after] = [of_joint, &with].map(|l| l.with(Load::Stuck).bandwidth());
            assert!(
                after > before / 3.0,
                "{before} Hz, {after} Hz: {:?}",
                with.law.design
            );
        }
    }
    // The test joint's drive, three times as stiff, has 75 Hz of its own beside a delay of 1.3 ms: no
    // design helps, and `torquectl check` refuses it.
    assert_eq!((by_default, chosen), (14, 20), "of {}", all.len());
}

#[test]
fn design_that_nothing_helps_stays_the_own() {
    // A drive whose own loop rings.
    let mut of_joint = joint(JOINTS[1]);
    if let DriveLoop::Position {
        stiffness, damping, ..
    } = &mut of_joint.law.drive
    {
        (*stiffness, *damping) = (40.0 * *stiffness, 0.1 * *damping);
    }
    of_joint.truth = of_joint.law;
    assert_eq!(
        choose_design(&of_joint, &NEEDED, f64::INFINITY),
        of_joint.law.design
    );
    // Nor do numbers without an end keep the search from one.
    of_joint.truth.rotor_inertia = 1e-300;
    assert_eq!(
        choose_design(&of_joint, &NEEDED, f64::INFINITY),
        of_joint.law.design
    );
}

/// A screw in N and m, and as a joint that turns at some radius: units change neither margins nor design.
#[test]
fn units_do_not_matter() {
    let at = |r: f64| joint([31.6, 1.06e6, 1.5e6, 12_945.0, 12.04].map(|x: f64| r * r * x));
    for radius in [1e-3, 0.1, 1.0, 30.0] {
        let both = [at(0.03), at(radius)];
        for load in Load::ALL {
            let [a, b] = both.map(|of_joint| of_joint.with(load).margins());
            let differ = [a.phase - b.phase, a.gain / b.gain - 1.0];
            assert!(
                differ.iter().all(|d| d.abs() < 1e-3),
                "{radius} m: {a:?} {b:?}"
            );
        }
        let [a, b] = both.map(|of_joint| choose_design(&of_joint, &NEEDED, f64::INFINITY));
        assert_eq!(a, b, "{radius} m");
    }
}
