//! Whether torques follow from the sensors, told where the configuration says otherwise.

use crate::reader::Section;
use dynamics::Model;
use estimators::whole_body::{WholeBody, WholeBodyError, WholeBodyParameters};

/// Notes why the whole-body estimator refuses the sensors, if it does.
pub(crate) fn check(root: &Section<'_, '_>, model: &Model, parameters: &WholeBodyParameters) {
    use WholeBodyError as E;
    let Err(error) = WholeBody::new(model, parameters) else {
        return;
    };
    let text = error.to_string();
    let (what, allowed) = text.split_once("; allowed: ").unwrap_or((&text, ""));
    match &error {
        E::UnknownLink(_, link) => match naming(root, link) {
            Some((section, key)) => {
                let what = format!("the URDF has no link {link}");
                section.problem(key, what, links(model));
            }
            None => root.problem("", what, allowed),
        },
        E::SensorOnRoot(sensor) | E::SameCut(_, sensor) => {
            at_sensor(root, sensor).problem("frame", what, allowed);
        }
        E::ContactNotBeyond(sensor, _) | E::ContactBeyondOther(sensor, ..) => {
            at_sensor(root, sensor).problem("contact_link", what, allowed);
        }
        E::UnknownWrenchBeyondSensor(..) | E::UnknownWrenchWithFixedBase(_) => {
            let section = root.optional_section("whole_body");
            let section = section.as_ref().unwrap_or(root);
            section.problem("unknown_wrench_link", what, allowed);
        }
        E::NoImu => {
            let section = root.optional_section("robot");
            let allowed = "\"fixed\", or a table [imu]";
            section
                .as_ref()
                .unwrap_or(root)
                .problem("base", what, allowed);
        }
        E::UnknownJoint(_) | E::JointNotNamedOnce(_) | E::BadSigma(_) => {
            root.problem("joint", what, allowed);
        }
    }
}

/// The table of the F/T sensor of that name, or the whole file.
fn at_sensor<'n, 't>(root: &Section<'n, 't>, name: &str) -> Section<'n, 't> {
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
    let imu = root.optional_section("imu").into_iter();
    let keys = ["frame", "contact_link", "unknown_wrench_link"];
    sensors.chain(imu).chain(whole_body).find_map(|section| {
        let key = keys.into_iter().find(|key| section.is(key, link))?;
        Some((section, key))
    })
}

/// The URDF's links, cut where there are many.
fn links(model: &Model) -> String {
    const SHOWN: usize = 60;
    let names: Vec<&str> = model
        .frames()
        .iter()
        .map(|frame| frame.name.as_str())
        .collect();
    let more = match names.len().saturating_sub(SHOWN) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    names[..names.len().min(SHOWN)].join(", ") + &more
}
