//! `[whole_body]`, `[fixed_base]` and `[[contacts]]`.

use crate::general::name;
use crate::parameters::{AngularAcceleration, ContactSet, FtParameters, Stand, WholeBodySettings};
use crate::reader::{Allowed, Section};
use robot_state::MAX_CONTACT_SETS;
use whole_body::{ContactKind, ContactParameters, Hypothesis, LoadRule, Weighting};

const LINK: &str = "the name of a link of the URDF";
/// The name by which clients ask for the automatic rule.
const AUTOMATIC: &str = "automatic";

/// `[whole_body]` and `[[contacts]]`.
pub(crate) fn whole_body(root: &Section<'_, '_>, sensors: &[FtParameters]) -> WholeBodySettings {
    use AngularAcceleration::{Differentiate, Neglect};
    let mut settings = WholeBodySettings {
        stand: stand(root),
        unknown_wrench_link: None,
        angular_acceleration: Differentiate,
        weighting: Weighting::Unit,
        sigma_model: 0.01,
        contacts: Vec::new(),
        blend: 0.1,
        load_rule: None,
    };
    if let Some(section) = root.optional_section("whole_body") {
        settings.unknown_wrench_link = section
            .optional_text("unknown_wrench_link", LINK)
            .map(|text| text.value.to_owned());
        let choices = [("differentiate", Differentiate), ("neglect", Neglect)];
        settings.angular_acceleration =
            section.choice_or("angular_acceleration", Differentiate, &choices);
        let choices = [("unit", Weighting::Unit), ("expected", Weighting::Expected)];
        settings.weighting = section.choice_or("weights", Weighting::Unit, &choices);
        let per_cent = section.number_or("model_sigma_per_cent", 1.0, Allowed::Within(0.0, 100.0));
        settings.sigma_model = 0.01 * per_cent;
        let blend_ms = section.number_or("blend_ms", 100.0, Allowed::Within(0.0, 10_000.0));
        settings.blend = 1e-3 * blend_ms;
        settings.load_rule = section.optional_section("load").map(load_rule);
        section.finish();
    }
    settings.contacts = contact_sets(root, sensors);
    let without_load = settings.contacts.iter().all(|set| set.loaded.is_empty());
    if let Some(section) = root.optional_section("whole_body") {
        if settings.load_rule.is_some() && without_load {
            let allowed =
                "a table [[contacts]] with `loaded` or `unloaded`, or no table [whole_body.load]";
            section.problem(
                "load",
                "no contact set has `loaded` or `unloaded`, so the rule chooses none",
                allowed,
            );
        }
        if settings.unknown_wrench_link.is_some() && !settings.contacts.is_empty() {
            let allowed = "tables [[contacts]], or unknown_wrench_link, not both";
            let what = "the tables [[contacts]] name the contacts already";
            section.problem("unknown_wrench_link", what, allowed);
        }
    }
    let contact_link = sensors.iter().find(|ft| ft.sensor.contact_link.is_some());
    if let (Some(ft), false) = (contact_link, settings.contacts.is_empty()) {
        let what = format!(
            "the tables [[contacts]] name the contacts, and F/T sensor {} has a contact_link too",
            ft.sensor.name
        );
        root.problem("contacts", what, "one or the other");
    }
    if settings.load_rule.is_none() && !without_load {
        let what = "`loaded` and `unloaded` need the rule that determines when a sensor is loaded";
        root.problem("contacts", what, "a table [whole_body.load]");
    }
    settings
}

/// `[fixed_base]`.
fn stand(root: &Section<'_, '_>) -> Option<Stand> {
    let section = root.optional_section("fixed_base")?;
    let link = section.text("link", LINK);
    let gravity = [0.0, 0.0, -dynamics::GRAVITY];
    let gravity = section.number_array_or::<3>("gravity_m_per_s2", gravity, Allowed::Finite);
    if root
        .optional_section("robot")
        .is_some_and(|robot| robot.is("base", "fixed"))
    {
        let what = "base = \"fixed\" holds the root link already";
        section.problem(
            "link",
            what,
            "base = \"floating\" in [robot], and here the link that the stand holds",
        );
    }
    section.finish();
    Some(Stand {
        link: link?.value.to_owned(),
        gravity,
    })
}

fn load_rule(section: Section<'_, '_>) -> LoadRule {
    let rule = LoadRule {
        on: section.number("on_N", Allowed::Positive),
        off: section.number("off_N", Allowed::Positive),
        hold: 1e-3 * section.number_or("hold_ms", 20.0, Allowed::Within(0.0, 10_000.0)),
    };
    if rule.off >= rule.on {
        let what = "off_N is not below on_N, so the rule has no hysteresis";
        section.problem("off_N", what, "off_N < on_N");
    }
    section.finish();
    rule
}

fn contact_sets(root: &Section<'_, '_>, sensors: &[FtParameters]) -> Vec<ContactSet> {
    let mut sections = root.list("contacts");
    if sections.len() > MAX_CONTACT_SETS {
        let what = format!("{} contact sets are not allowed", sections.len());
        root.problem("contacts", what, format!("at most {MAX_CONTACT_SETS}"));
        sections.truncate(MAX_CONTACT_SETS);
    }
    let mut sets = Vec::<ContactSet>::new();
    for mut section in sections {
        let name = name(&section, "name");
        section.which = format!(" ({name})");
        if name == AUTOMATIC || sets.iter().any(|other| other.hypothesis.name == name) {
            let allowed = format!("each name once, and not {AUTOMATIC:?}");
            section.problem("name", format!("{name:?} is not allowed here"), allowed);
        }
        let mut loaded = sensors_of(&section, "loaded", sensors, true);
        loaded.extend(sensors_of(&section, "unloaded", sensors, false));
        if (loaded.iter()).any(|(s, is)| loaded.contains(&(*s, !is))) {
            let what = "a sensor is both loaded and unloaded";
            section.problem("unloaded", what, "each sensor in one of the lists");
        }
        let touches = section.list("touch");
        if touches.is_empty() {
            let allowed = "touch = [{ link = \"left_foot\", type = \"full_wrench\" }, …], one at \
                           least for each part of the robot";
            section.problem("touch", "no contact is named", allowed);
        }
        let contacts = touches.into_iter().map(contact).collect();
        section.finish();
        let hypothesis = Hypothesis { name, contacts };
        sets.push(ContactSet { hypothesis, loaded });
    }
    sets
}

/// The sensors that a list names, with their state of load.
fn sensors_of(
    section: &Section<'_, '_>,
    key: &'static str,
    sensors: &[FtParameters],
    loaded: bool,
) -> Vec<(usize, bool)> {
    let names: Vec<&str> = sensors.iter().map(|ft| ft.sensor.name.as_str()).collect();
    let allowed = format!("names of F/T sensors: {}", names.join(", "));
    let texts = section.optional_texts(key, &allowed);
    let place = |name: &str| names.iter().position(|own| *own == name);
    let found = texts.iter().filter_map(|text| {
        let sensor = place(text.value);
        if sensor.is_none() {
            section.problem(key, format!("{:?} is no F/T sensor", text.value), &allowed);
        }
        Some((sensor?, loaded))
    });
    found.collect()
}

fn contact(section: Section<'_, '_>) -> ContactParameters {
    let link = section.text("link", LINK);
    let point = section.number_array_or::<3>("point_m", [0.0; 3], Allowed::Finite);
    #[derive(Clone, Copy, PartialEq)]
    enum Kind {
        FullWrench,
        PureForce,
        KnownDirection,
        Nothing,
    }
    let choices = [
        ("full_wrench", Kind::FullWrench),
        ("pure_force", Kind::PureForce),
        ("known_direction", Kind::KnownDirection),
        ("none", Kind::Nothing),
    ];
    let kind = section.choice("type", &choices);
    let direction = section.number_array_or::<3>("direction", [0.0; 3], Allowed::Finite);
    let directed = kind == Kind::KnownDirection;
    if directed == (direction == [0.0; 3]) {
        let what = if directed {
            "a force of known direction needs its direction"
        } else {
            "only a force of known direction has a direction"
        };
        let allowed = "type = \"known_direction\" with direction = [x, y, z], not all zero";
        section.problem("direction", what, allowed);
    }
    section.finish();
    ContactParameters {
        link: link.map_or_else(String::new, |text| text.value.to_owned()),
        point: point.into(),
        kind: match kind {
            Kind::FullWrench => ContactKind::FullWrench,
            Kind::PureForce => ContactKind::PureForce,
            Kind::KnownDirection => ContactKind::KnownDirection(direction.into()),
            Kind::Nothing => ContactKind::Nothing,
        },
    }
}
