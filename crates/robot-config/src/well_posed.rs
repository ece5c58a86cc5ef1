//! Checks that torques can be determined from the sensors, and notes at which key they cannot.

use crate::parameters::Parameters;
use crate::reader::Section;
use crate::whole_body::{FilterGains, whole_body_parameters};
use dynamics::{Base, Model};
use problem::{Problem, listed};
use whole_body::{ContactProblem, WholeBody, WholeBodyError, part_of_link};

/// Notes the whole-body estimator's refusal of sensors and contacts, if it refuses them.
pub(crate) fn check(root: &Section<'_, '_>, model: &Model, parameters: &Parameters) {
    if imu_misplaced(root, model, parameters) {
        return;
    }
    let gains = FilterGains {
        sensor: [1.0; 2],
        sigma_ddq: vec![0.0; parameters.joints.len()],
    };
    let Some(whole_body) = whole_body_parameters(parameters, model, &gains) else {
        let section = root.optional_section("robot");
        section.as_ref().unwrap_or(root).problem(
            "base",
            "a floating base needs an IMU: without it acceleration and weight are unknown",
            "\"fixed\", or a table [imu], or a stand: a table [fixed_base]",
        );
        return;
    };
    if let Some(frame) = (parameters.external_torque.as_ref()).and_then(|e| e.frame.as_ref())
        && (model.frame_index(frame)).is_none_or(|f| model.frames()[f].body == 0)
        && let Some(section) = root.optional_section("external_torque")
    {
        let what = format!("{frame:?} is no link that joints move");
        section.problem(
            "frame",
            what,
            "a link of the URDF beyond at least one joint",
        );
    }
    if parameters.whole_body.contacts.is_empty() && contacts_misplaced(root, model, parameters) {
        return;
    }
    if let Err(error) = WholeBody::new(model, &whole_body) {
        note(root, model, &error);
    }
}

/// Notes IMUs in frames that the model lacks; true if there are any.
fn imu_misplaced(root: &Section<'_, '_>, model: &Model, parameters: &Parameters) -> bool {
    let mut any = false;
    let sections = root.one_or_list("imu").into_iter();
    for (index, (imu, mut section)) in parameters.imus.iter().zip(sections).enumerate() {
        if index > 0 {
            section.which = format!(" ({})", index + 1);
        }
        if model.frame_index(&imu.frame).is_none() {
            let links = model.frames().iter().map(|frame| frame.name.as_str());
            let what = format!("the URDF has no link {}", imu.frame);
            section.problem("frame", what, listed(links));
            any = true;
        }
    }
    any
}

/// Notes contact links that lie on another part than the one they are for; true if there are any.
fn contacts_misplaced(root: &Section<'_, '_>, model: &Model, parameters: &Parameters) -> bool {
    let sensors = || parameters.ft_sensors.iter().map(|ft| &ft.sensor);
    let cuts: Vec<&str> = sensors().map(|s| s.frame.as_str()).collect();
    let cuts_off = |link: &&str| {
        let link = model.frame_index(link);
        link.is_some_and(|l| model.frames()[l].parent.is_some())
    };
    if !cuts.iter().all(cuts_off) {
        // The estimator refuses these itself.
        return false;
    }
    let mut any = false;
    for (s, sensor) in sensors().enumerate() {
        let Some(link) = &sensor.contact_link else {
            continue;
        };
        if part_of_link(model, &cuts, link).is_some_and(|part| part != s + 1) {
            let what = format!(
                "link {link} is not beyond the sensor, or lies beyond another one, which has a \
                 contact link of its own"
            );
            let allowed = "the sensor's frame and the links beyond it, up to the next sensors";
            ft_sensor(root, &sensor.name).problem("contact_link", what, allowed);
            any = true;
        }
    }
    let Some(link) = &parameters.whole_body.unknown_wrench_link else {
        return any;
    };
    let moves = (model.frame_index(link)).is_some_and(|l| model.frames()[l].body != 0);
    let section = root.optional_section("whole_body");
    let section = section.as_ref().unwrap_or(root);
    if let Some(part @ 1..) = part_of_link(model, &cuts, link) {
        let name = sensors().nth(part - 1).map_or("", |s| &s.name);
        let what = format!(
            "link {link} lies beyond F/T sensor {name}, whose contact wrench is unknown too: the two \
             cannot be distinguished"
        );
        section.problem("unknown_wrench_link", what, "links before every F/T sensor");
        any = true;
    } else if model.base() == Base::Fixed && moves {
        let what = format!(
            "link {link} moves, but the base is fixed, and the wrench of its mounting is unknown \
             already"
        );
        section.problem(
            "unknown_wrench_link",
            what,
            "a link that does not move, or no such key",
        );
        any = true;
    }
    any
}

/// Notes the estimator's refusal at the table and the key that it is about.
fn note(root: &Section<'_, '_>, model: &Model, error: &WholeBodyError) {
    use WholeBodyError as E;
    let Problem {
        reason, allowed, ..
    } = error.problem();
    let at = |section: &Section<'_, '_>, key: &str| section.problem(key, &reason, &allowed);
    match error {
        E::Contacts {
            hypothesis,
            problem,
        } if let Some(section) = contact_set(root, hypothesis) => {
            // The table's name stands in the message already.
            let Problem {
                reason, allowed, ..
            } = problem.problem();
            section.problem("touch", reason, allowed);
        }
        E::UnknownLink(_, link)
        | E::Contacts {
            problem: ContactProblem::UnknownLink(link),
            ..
        } => match naming(root, link) {
            Some((section, key)) => {
                let what = format!("the URDF has no link {link}");
                section.problem(
                    key,
                    what,
                    listed(model.frames().iter().map(|frame| frame.name.as_str())),
                );
            }
            None => at(root, ""),
        },
        E::SensorOnRoot(sensor) | E::SameCut(_, sensor, _) | E::SensorNamedTwice(sensor) => {
            at(&ft_sensor(root, sensor), "frame");
        }
        E::SingularWeights(_) => match root.optional_section("whole_body") {
            Some(section) => at(&section, "weights"),
            None => at(root, ""),
        },
        E::UnknownJoint(_) | E::JointNotNamedOnce(_) => at(root, "joint"),
        E::Contacts { .. } | E::NoHypothesis | E::HypothesisNamedTwice(_) | E::BadNumber(_) => {
            at(root, "");
        }
    }
}

/// The table of the contact set of that name.
fn contact_set<'n, 't>(root: &Section<'n, 't>, name: &str) -> Option<Section<'n, 't>> {
    let mut sets = root.list("contacts").into_iter();
    let mut section = sets.find(|section| section.is("name", name))?;
    section.which = format!(" ({name})");
    Some(section)
}

/// The table of the F/T sensor of that name, or the whole file.
fn ft_sensor<'n, 't>(root: &Section<'n, 't>, name: &str) -> Section<'n, 't> {
    let mut sensors = root.list("ft_sensor").into_iter();
    let found = sensors.find(|section| section.is("name", name));
    match found {
        Some(mut section) => {
            section.which = format!(" ({name})");
            section
        }
        None => root.again(),
    }
}

/// The first key that names the link.
fn naming<'n, 't>(root: &Section<'n, 't>, link: &str) -> Option<(Section<'n, 't>, &'static str)> {
    let sensors = root.list("ft_sensor").into_iter();
    let whole_body = root.optional_section("whole_body").into_iter();
    let imus = root.one_or_list("imu").into_iter();
    let stand = root.optional_section("fixed_base").into_iter();
    let keys = ["frame", "contact_link", "unknown_wrench_link", "link"];
    let mut sections = sensors.chain(imus).chain(whole_body).chain(stand);
    sections.find_map(|section| {
        let key = keys.into_iter().find(|key| section.is(key, link))?;
        Some((section, key))
    })
}
