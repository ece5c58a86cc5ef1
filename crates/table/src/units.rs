//! Words of units, as a row below the header has them.

/// A unit, as far as it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// Units of the SI in one of it.
    pub factor: f64,
    /// That unit's name.
    pub si: &'static str,
}

/// Names of units, of the SI's unit and its multiples.
const KNOWN: [(&str, f64, &[&str]); 15] = [
    ("s", 1.0, &["s", "sec", "second", "seconds"]),
    ("s", 1e-3, &["ms", "msec", "milliseconds"]),
    (
        "s",
        1e-6,
        &["us", "usec", "\u{b5}s", "\u{3bc}s", "microseconds"],
    ),
    ("s", 1e-9, &["ns", "nsec", "nanoseconds"]),
    ("rad", 1.0, &["rad", "radian", "radians"]),
    (
        "rad",
        std::f64::consts::PI / 180.0,
        &["deg", "degree", "degrees", "\u{b0}"],
    ),
    (
        "rad",
        std::f64::consts::TAU,
        &["rev", "turn", "turns", "revolutions"],
    ),
    ("A", 1.0, &["a", "amp", "ampere", "amperes"]),
    ("A", 1e-3, &["ma"]),
    ("N·m", 1.0, &["nm", "n·m", "n*m", "n.m", "n-m", "n m"]),
    ("N·m", 1e-3, &["mnm", "mn·m", "mn*m"]),
    ("N·m", 1e3, &["knm", "kn·m", "kn*m"]),
    ("N", 1.0, &["n", "newton"]),
    ("m", 1.0, &["m", "metre", "meter"]),
    ("m", 1e-3, &["mm"]),
];

impl Unit {
    /// A unit by its word, in brackets or not.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let bare = bare(text).to_lowercase();
        let found = KNOWN
            .iter()
            .find(|(_, _, words)| words.contains(&bare.as_str()));
        found.map(|&(si, factor, _)| Self { factor, si })
    }
}

/// Whether a field may stand in a row of units: a short word or a product of units, no number.
pub(crate) fn is_unit(text: &str) -> bool {
    let bare = bare(text);
    let absent = ["-", "--", "", "1", "nan", "n/a", "na", "null", "none"];
    absent.contains(&bare.to_lowercase().as_str())
        || (bare.chars().count() <= 16 && !super::is_number(bare))
}

fn bare(text: &str) -> &str {
    text.trim().trim_matches(['[', ']', '(', ')', '"', '\''])
}
