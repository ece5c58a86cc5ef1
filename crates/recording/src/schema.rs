//! Schemas: of our own messages, for whoever reads them without this crate, and of ROS 2's.

use robot_state::{Layout, Reference, Settings, Shape, SharedRecord};
use serde_json::{Value, json};

use crate::compact::{Counts, used};
use crate::header::Header;

/// Name and encoding of our own schema; also the encoding of its messages.
pub(crate) const OWN_NAME: &str = "torqued/Cycle";
pub(crate) const OWN_ENCODING: &str = "torqued";
/// The channel of our own messages.
pub(crate) const OWN_TOPIC: &str = "/torqued/cycle";

/// The message's head and the records' fields with their places in the compact layout.
pub(crate) fn own(counts: Counts) -> String {
    let message = include_str!("message.rs").lines();
    let head: Vec<&str> = message
        .take_while(|line| line.starts_with("//!"))
        .map(|line| line.trim_start_matches("//!").trim_start_matches(' '))
        .collect();
    let schema = json!({
        "layout": format!("{:016x}", Header::layout()),
        "message": head,
        "record": described(&SharedRecord::SHAPE, counts),
        "reference": described(&Reference::SHAPE, counts),
        "settings": described(&Settings::SHAPE, counts),
    });
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

/// Encodings of ROS 2's schemas and messages.
pub(crate) const ROS_SCHEMA: &str = "ros2msg";
pub(crate) const ROS_MESSAGE: &str = "cdr";

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
