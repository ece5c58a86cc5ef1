//! Messages of ROS 2 for other people's tools: joint states, wrenches and IMUs of every cycle.

use robot_state::CycleRecord;

use crate::cdr::Cdr;
use crate::schema;

/// A channel of ROS 2's messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RosChannel {
    /// Its topic, e.g. `/joint_states`.
    pub topic: String,
    /// Name of its messages' schema, e.g. `sensor_msgs/msg/JointState`.
    pub schema_name: &'static str,
    /// The schema's text, with those that it names.
    pub schema: String,
}

impl RosChannel {
    /// Encoding of the schema.
    pub const SCHEMA_ENCODING: &str = "ros2msg";
    /// Encoding of the messages.
    pub const ENCODING: &str = "cdr";
}

/// Writes the messages of a robot's cycles; the memory is taken once.
#[derive(Debug, Clone)]
pub struct RosMessages {
    joints: Vec<String>,
    sensors: Vec<String>,
    imus: Vec<String>,
    cdr: Cdr,
}

impl RosMessages {
    /// Of a robot with these joints, F/T sensors and frames of IMUs.
    #[must_use]
    pub fn new(joints: &[String], sensors: &[String], imus: &[String]) -> Self {
        Self {
            joints: joints.to_vec(),
            sensors: sensors.to_vec(),
            // The first one shows the base's motion, and there is a channel for it in any case.
            imus: std::iter::once("imu".to_owned())
                .chain(imus.iter().skip(1).cloned())
                .collect(),
            cdr: Cdr::default(),
        }
    }

    /// The channels, in the order of the messages.
    #[must_use]
    pub fn channels(&self) -> Vec<RosChannel> {
        let channel = |topic: String, schema_name, schema| RosChannel {
            topic,
            schema_name,
            schema,
        };
        let (name, text) = ("sensor_msgs/msg/JointState", schema::joint_state());
        let joints = std::iter::once(channel("/joint_states".to_owned(), name, text));
        let wrenches = self.sensors.iter().map(|sensor| {
            let (name, text) = ("geometry_msgs/msg/WrenchStamped", schema::wrench());
            channel(format!("/wrench/{sensor}"), name, text)
        });
        let imus = self.imus.iter().enumerate().map(|(i, frame)| {
            let topic = if i == 0 {
                "/imu".to_owned()
            } else {
                format!("/imu/{frame}")
            };
            channel(topic, "sensor_msgs/msg/Imu", schema::imu())
        });
        joints.chain(wrenches).chain(imus).collect()
    }

    /// Gives the messages of a cycle, with the index of their channel, until one is refused.
    ///
    /// # Errors
    /// That of `put`.
    pub fn write<E>(
        &mut self,
        stamp_ns: u64,
        record: &CycleRecord,
        mut put: impl FnMut(usize, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let cdr = &mut self.cdr;
        cdr.joint_state(stamp_ns, &self.joints, record);
        put(0, cdr.bytes())?;
        let wrenches = self.sensors.iter().zip(&record.measured.ft);
        for (s, (sensor, measured)) in wrenches.enumerate() {
            cdr.wrench(stamp_ns, sensor, measured);
            put(1 + s, cdr.bytes())?;
        }
        let first = std::iter::once(&record.measured.imu);
        let measured = first.chain(&record.measured.further_imus);
        for (i, (frame, measured)) in self.imus.iter().zip(measured).enumerate() {
            cdr.imu(stamp_ns, frame, measured);
            put(1 + self.sensors.len() + i, cdr.bytes())?;
        }
        Ok(())
    }
}
