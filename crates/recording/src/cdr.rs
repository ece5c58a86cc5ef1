//! Messages of ROS 2 in CDR (OMG DDS, little-endian): numbers aligned to their size, counted from
//! the end of the four bytes that name the encoding.

use robot_state::{CycleRecord, FtMeasured, ImuMeasured, Wrench};

const ENCODING: [u8; 4] = [0, 1, 0, 0];

/// A message as it is written.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cdr(Vec<u8>);

impl Cdr {
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.0
    }

    fn begin(&mut self, stamp_ns: u64, frame: &str) {
        self.0.clear();
        self.0.extend_from_slice(&ENCODING);
        self.u32((stamp_ns / 1_000_000_000) as u32);
        self.u32((stamp_ns % 1_000_000_000) as u32);
        self.text(frame);
    }

    fn align(&mut self, size: usize) {
        let body = self.0.len() - ENCODING.len();
        self.0
            .resize(ENCODING.len() + body.next_multiple_of(size), 0);
    }

    fn u32(&mut self, number: u32) {
        self.align(4);
        self.0.extend_from_slice(&number.to_le_bytes());
    }

    fn f64(&mut self, number: f64) {
        self.align(8);
        self.0.extend_from_slice(&number.to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.0.extend_from_slice(text.as_bytes());
        self.0.push(0);
    }

    fn sequence(&mut self, numbers: impl ExactSizeIterator<Item = f64>) {
        self.u32(numbers.len() as u32);
        numbers.for_each(|number| self.f64(number));
    }

    /// `sensor_msgs/msg/JointState`: q, dq and tau_hat of every joint.
    pub(crate) fn joint_state(&mut self, stamp_ns: u64, names: &[String], record: &CycleRecord) {
        self.begin(stamp_ns, "");
        self.u32(names.len() as u32);
        names.iter().for_each(|name| self.text(name));
        let measured = || record.measured.joints.iter().take(names.len());
        self.sequence(measured().map(|joint| joint.q));
        self.sequence(measured().map(|joint| joint.dq));
        let estimated = record.estimated.joints.iter().take(names.len());
        self.sequence(estimated.map(|joint| joint.tau_hat.tau));
    }

    /// `geometry_msgs/msg/WrenchStamped`: a sensor's wrench, in its own frame.
    pub(crate) fn wrench(&mut self, stamp_ns: u64, frame: &str, measured: &FtMeasured) {
        self.begin(stamp_ns, frame);
        let Wrench { force, torque } = measured.wrench;
        force
            .into_iter()
            .chain(torque)
            .for_each(|number| self.f64(number));
    }

    /// `sensor_msgs/msg/Imu`, whose acceleration is that less gravity, as ours; without orientation.
    pub(crate) fn imu(&mut self, stamp_ns: u64, frame: &str, imu: &ImuMeasured) {
        self.begin(stamp_ns, frame);
        let no_orientation = [0.0, 0.0, 0.0, 1.0].into_iter().chain(covariance(-1.0));
        no_orientation
            .chain(imu.gyro)
            .chain(covariance(0.0))
            .chain(imu.accelerometer)
            .chain(covariance(0.0))
            .for_each(|number| self.f64(number));
    }
}

/// A covariance that is not known, or one of a value that is not given: -1 in its first element.
fn covariance(first: f64) -> [f64; 9] {
    let mut covariance = [0.0; 9];
    covariance[0] = first;
    covariance
}
