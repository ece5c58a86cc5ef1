//! Records of one cycle, a file for each group, and of the robot's description and references.

mod commanded;
mod commander;
mod cycle;
mod description;
mod estimated;
mod frames;
mod measured;
mod reference;
mod wrench;

pub use commanded::{CommandedRecord, JointCommanded, command_flags};
pub use commander::{CommanderRecord, CommanderStatus, lease_refusal, not_followed, piece_refusal};
pub use cycle::{CycleRecord, LoopRecord, SharedRecord};
pub use description::Description;
pub use estimated::{
    EstimatedRecord, FtEstimated, JointEstimated, TorqueEstimate, torque_flags, torque_source,
};
pub use frames::{FrameCommanded, FrameReference, MAX_FRAMES, frame_flags};
pub use measured::{
    FtMeasured, ImuMeasured, JointMeasured, MeasuredRecord, measured_flags, reported_flags,
};
pub use reference::{
    JointPoint, JointReference, MAX_POINTS, Mode, Reference, TrajectoryPiece, TrajectoryPoint,
};
pub use wrench::Wrench;

/// Joints a record can hold.
pub const MAX_JOINTS: usize = 64;
/// Force/torque sensors a record can hold.
pub const MAX_FT_SENSORS: usize = 8;
/// IMUs beside the first one.
pub const MAX_FURTHER_IMUS: usize = 3;
/// Contact sets a robot can have.
pub const MAX_CONTACT_SETS: usize = 16;

/// A value of all zeros, the start of every record.
pub trait Zero {
    /// All zeros.
    const ZERO: Self;
}
impl Zero for u8 {
    const ZERO: Self = 0;
}
impl Zero for u32 {
    const ZERO: Self = 0;
}
impl Zero for u64 {
    const ZERO: Self = 0;
}
impl Zero for f64 {
    const ZERO: Self = 0.0;
}
impl<T: Zero, const N: usize> Zero for [T; N] {
    const ZERO: Self = [T::ZERO; N];
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::{Layout, Shape, layout_hash};

    fn assert_packed(shape: &Shape) -> usize {
        match shape {
            Shape::U8 => 1,
            Shape::U32 => 4,
            Shape::U64 | Shape::F64 => 8,
            Shape::Array(element, count) => assert_packed(element) * count,
            Shape::Record(name, fields, size) => {
                let mut end = 0;
                for field in *fields {
                    assert_eq!(field.offset, end, "{name}.{} leaves a hole", field.name);
                    end += assert_packed(&field.shape);
                }
                assert_eq!(end, *size, "{name} has padding at its end");
                end
            }
        }
    }

    #[test]
    fn records_have_no_hidden_padding() {
        assert_packed(&SharedRecord::SHAPE);
        assert_packed(&Description::SHAPE);
        assert_packed(&Reference::SHAPE);
        assert_packed(&TrajectoryPiece::SHAPE);
        assert_packed(&CommanderStatus::SHAPE);
        assert_packed(&crate::Settings::SHAPE);
        assert_packed(&crate::Request::SHAPE);
        assert_packed(&crate::Answer::SHAPE);
    }

    #[test]
    fn different_records_have_different_hashes() {
        assert_ne!(layout_hash::<SharedRecord>(), layout_hash::<Reference>());
        assert_ne!(layout_hash::<Description>(), layout_hash::<Reference>());
    }
}
