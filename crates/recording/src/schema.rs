//! Schemas: of our own messages, for whoever reads them without this crate, and of ROS 2's.

use robot_state::{
    Content, CycleRecord, Layout, LoopRecord, Reference, Settings, Shape, SharedRecord,
};
use serde_json::{Value, json};

use crate::compact::{Counts, used};
use crate::fields::Field;
use crate::header::Header;
use crate::torques::TorquesCoder;

/// Encoding of our own schemas; also the encoding of their messages.
pub(crate) const OWN_ENCODING: &str = "torqued";

/// Name of our own schema, and the channel of its messages.
pub(crate) fn own_names(content: Content) -> (&'static str, &'static str) {
    match content {
        Content::All => ("torqued/Cycle", "/torqued/cycle"),
        Content::Frames => ("torqued/Frames", "/torqued/frames"),
        Content::Torques => ("torqued/Torques", "/torqued/torques"),
    }
}

/// The message's head and the records' fields with their places in the compact layout.
pub(crate) fn own(content: Content, counts: Counts) -> String {
    let message = match content {
        Content::All => include_str!("message.rs"),
        Content::Frames => include_str!("frames.rs"),
        Content::Torques => include_str!("torques.rs"),
    };
    let head: Vec<&str> = (message.lines())
        .take_while(|line| line.starts_with("//!"))
        .map(|line| line.trim_start_matches("//!").trim_start_matches(' '))
        .collect();
    let layout = format!("{:016x}", Header::layout());
    let record = described(&SharedRecord::SHAPE, counts);
    let reference = described(&Reference::SHAPE, counts);
    let settings = described(&Settings::SHAPE, counts);
    let schema = match content {
        Content::All => json!({
            "layout": layout,
            "message": head,
            "record": record,
            "reference": reference,
            "settings": settings,
        }),
        Content::Frames => json!({
            "layout": layout,
            "message": head,
            "record_head": described(&CycleRecord::SHAPE, counts),
            "loop": described(&LoopRecord::SHAPE, counts),
            "reference": reference,
            "settings": settings,
        }),
        Content::Torques => {
            let coder = TorquesCoder::new(counts);
            let fields = coder.fields().iter();
            let field = |field: &Field| {
                let kind = format!("{:?}", field.kind).to_lowercase();
                json!({ "name": field.path, "type": kind, "doc": field.doc.trim() })
            };
            json!({
                "layout": layout,
                "message": head,
                "fields": fields.map(field).collect::<Value>(),
            })
        }
    };
    schema.to_string()
}

fn described(shape: &Shape, counts: Counts) -> Value {
    match shape {
        Shape::U8 => json!("u8"),
        Shape::U32 => json!("u32"),
        Shape::U64 => json!("u64"),
        Shape::F64 => json!("f64"),
        Shape::Array(element, count) => json!({
            "count": used(element, *count, counts),
            "of": described(element, counts),
        }),
        Shape::Record(_, fields, _) => (fields.iter())
            .map(|field| {
                json!({
                    "name": field.name,
                    "type": described(&field.shape, counts),
                    "doc": field.doc.trim(),
                })
            })
            .collect(),
    }
}

const BETWEEN: &str =
    "================================================================================\n";
const TIME: &str = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
const HEADER: &str = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
const VECTOR: &str = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n";

fn with_dependencies(message: &str, dependencies: &[&str]) -> String {
    let mut text = message.to_owned();
    for dependency in dependencies {
        text += BETWEEN;
        text += dependency;
    }
    text
}

/// `sensor_msgs/msg/JointState`.
pub(crate) fn joint_state() -> String {
    let message = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n";
    with_dependencies(message, &[HEADER, TIME])
}

/// `geometry_msgs/msg/WrenchStamped`.
pub(crate) fn wrench() -> String {
    let wrench =
        "MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n";
    let message = "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n";
    with_dependencies(message, &[HEADER, TIME, wrench, VECTOR])
}

/// `sensor_msgs/msg/Imu`.
pub(crate) fn imu() -> String {
    let quaternion = "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";
    let message = "std_msgs/Header header\n\
        geometry_msgs/Quaternion orientation\n\
        float64[9] orientation_covariance\n\
        geometry_msgs/Vector3 angular_velocity\n\
        float64[9] angular_velocity_covariance\n\
        geometry_msgs/Vector3 linear_acceleration\n\
        float64[9] linear_acceleration_covariance\n";
    with_dependencies(message, &[HEADER, TIME, quaternion, VECTOR])
}
