//! Limits of the drive's own, compared with what the configuration asks of it.

use super::{Object, number};

/// A limit that a drive has of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Bound {
    /// The object.
    pub object: Object,
    /// Quantity that is limited, for messages.
    pub meaning: &'static str,
    /// Counts in two's complement, of the object's length.
    pub signed: bool,
    /// The limit is the least value that is allowed, not the greatest.
    pub lower: bool,
    /// One count, in `unit`.
    pub count: f64,
    /// Unit, for messages.
    pub unit: &'static str,
    /// Least reach of the limit that the joint needs, in `unit`.
    pub asked: f64,
    /// The key that asks it, for messages.
    pub key: &'static str,
    /// Values that stand for no limit.
    pub none: &'static [i64],
}

/// A drive's limit beside the configuration.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Verdict {
    /// As asked, or a little more.
    Fits,
    /// It allows less than is asked: how much.
    Less(String),
    /// It allows more than is asked, or anything: how much.
    More(String),
}

/// Share of what is asked by which a drive may allow more without a word.
const MORE: f64 = 0.1;

impl Bound {
    /// Judges the value that the drive sent for the object.
    pub(super) fn judge(&self, bytes: &[u8]) -> Verdict {
        let bits = 8 * bytes.len().clamp(1, 4) as u32;
        let raw = number(bytes);
        let value = if self.signed {
            i64::from((raw << (32 - bits)).cast_signed() >> (32 - bits))
        } else {
            i64::from(raw)
        };
        let Self {
            asked,
            key,
            unit,
            meaning,
            ..
        } = self;
        let says = |allowed: String| {
            format!("{meaning}: the drive allows {allowed}, {key} is {asked:.4} {unit}")
        };
        if self.none.contains(&value) {
            return Verdict::More(says("anything".to_owned()));
        }
        let allowed = value as f64 * self.count;
        let reserve = if self.lower {
            asked - allowed
        } else {
            allowed - asked
        };
        let shown = || says(format!("{allowed:.4} {unit}"));
        if reserve < -self.count.abs() {
            Verdict::Less(shown())
        } else if reserve > MORE * asked.abs() + self.count.abs() {
            Verdict::More(shown())
        } else {
            Verdict::Fits
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_compared_in_their_unit_and_sense() {
        let torque = Bound {
            object: Object::new(0x6072, 0),
            meaning: "greatest torque",
            signed: false,
            lower: false,
            count: 0.025,
            unit: "N·m",
            asked: 37.0,
            key: "torque_limit_Nm",
            none: &[0xFFFF],
        };
        let of = |value: u16| torque.judge(&value.to_le_bytes());
        assert_eq!(of(1480), Verdict::Fits);
        assert_eq!(of(1600), Verdict::Fits);
        let Verdict::Less(less) = of(1000) else {
            panic!("{:?}", of(1000));
        };
        let all = "greatest torque: the drive allows 25.0000 N·m, torque_limit_Nm is 37.0000 N·m";
        assert_eq!(less, all);
        assert!(matches!(of(3000), Verdict::More(_)));
        assert!(matches!(of(0xFFFF), Verdict::More(more) if more.contains("anything")));
        let least = Bound {
            signed: true,
            lower: true,
            count: 0.01,
            asked: -90.0,
            none: &[],
            ..torque
        };
        let of = |value: i32| least.judge(&value.to_le_bytes());
        assert_eq!(of(-9000), Verdict::Fits);
        assert!(matches!(of(-8000), Verdict::Less(_)));
        assert!(matches!(of(-18000), Verdict::More(_)));
    }
}
