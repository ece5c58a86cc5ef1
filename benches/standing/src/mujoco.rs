//! The humanoid in MuJoCo: a process of `rt-tests/second-world/world.py`, in lock-step by its standard input and output.
//!
//! Here its numbers become the frames of the buses, by the tables of the configuration.

use crate::stand::{Body, PUSHED_S, World, root};
use can_codec::{Frame, Frames};
use robot_config::slots::{self, Sent};
use robot_config::{Robot, slots::send_len};
use std::io::{Read, Write};
use std::process::{Child, Command, Stdio};

/// See the module.
pub(crate) struct Mujoco {
    child: Child,
    robot: Robot,
    values: Vec<f64>,
    commands: Vec<f64>,
    /// Set-points, control words and the force.
    sent: Vec<f64>,
    answer: Vec<u8>,
    body: Body,
    force: [f64; 2],
    start: f64,
    time: f64,
}

/// Numbers of the base at the end of an answer: orientation, angular velocity, height.
const OF_BASE: usize = 8;

impl Mujoco {
    /// The robot whose chest a force (N, world axes) pushes for 0.3 s from `start` (s) on.
    ///
    /// # Errors
    /// No Python with MuJoCo.
    pub(crate) fn new(
        robot: &Robot,
        seed: u64,
        force: [f64; 2],
        start: f64,
    ) -> Result<Self, String> {
        let python = root().join(".venv/bin/python");
        let child = Command::new(&python)
            .current_dir(root())
            .env("OMP_NUM_THREADS", "1")
            .args([
                "rt-tests/second-world/world.py",
                "config/humanoid/robot.toml",
                "--seed",
            ])
            .arg(seed.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn();
        let child = child.map_err(|e| {
            format!(
                "{}: {e}: rt-tests/install.sh makes this environment",
                python.display()
            )
        })?;
        let p = &robot.parameters;
        let n = p.joints.len();
        let numbers = 6 * n + 6 * p.ft_sensors.len() + 6 + OF_BASE;
        Ok(Self {
            child,
            values: vec![0.0; slots::receive_len(p)],
            commands: vec![0.0; send_len(p)],
            sent: vec![0.0; 2 * n + 3],
            answer: vec![0; 8 * numbers],
            body: Body::default(),
            robot: robot.clone(),
            force,
            start,
            time: 0.0,
        })
    }

    fn exchange(&mut self) -> std::io::Result<()> {
        let closed = || std::io::Error::from(std::io::ErrorKind::BrokenPipe);
        let bytes: Vec<u8> = self.sent.iter().flat_map(|x| x.to_le_bytes()).collect();
        let input = self.child.stdin.as_mut().ok_or_else(closed)?;
        input.write_all(&bytes)?;
        input.flush()?;
        let output = self.child.stdout.as_mut().ok_or_else(closed)?;
        output.read_exact(&mut self.answer)
    }

    /// Puts the numbers of an answer into the places of the configuration's signals.
    fn place(&mut self) {
        let (joints, sensors) = {
            let p = &self.robot.parameters;
            (p.joints.len(), p.ft_sensors.len())
        };
        let mut numbers = self.answer.chunks_exact(8).map(|bytes| {
            let mut number = [0; 8];
            number.copy_from_slice(bytes);
            f64::from_le_bytes(number)
        });
        let places = [
            slots::motor_angle,
            slots::link_angle,
            slots::current,
            slots::velocity,
            slots::status,
        ];
        let of_joints = places.iter().flat_map(|place| (0..joints).map(place));
        let of_sensors = (0..sensors).flat_map(|s| (0..6).map(move |axis| slots::ft(s, axis)));
        let gyro = (0..3).map(|axis| slots::gyro(0, axis));
        let accelerometer = (0..3).map(|axis| slots::accelerometer(0, axis));
        for slot in of_joints.chain(of_sensors).chain(gyro).chain(accelerometer) {
            if let (Some(place), Some(number)) = (self.values.get_mut(slot), numbers.next()) {
                *place = number;
            }
        }
        let rest: Vec<f64> = numbers.skip(joints).collect();
        if let [w, x, y, z, a, b, c, height] = *rest {
            self.body = Body {
                orientation: [w, x, y, z],
                turns: (a * a + b * b + c * c).sqrt(),
                height,
            };
        }
    }
}

impl World for Mujoco {
    fn answer(&mut self, now: u64, rx: &mut Frames) -> Result<(), String> {
        let pushed = (self.start..self.start + PUSHED_S).contains(&self.time);
        let [x, y] = if pushed { self.force } else { [0.0; 2] };
        let n = self.robot.parameters.joints.len();
        self.sent[2 * n..].copy_from_slice(&[x, y, 0.0]);
        self.exchange()
            .map_err(|e| format!("the world in MuJoCo has ended: {e}"))?;
        self.time += self.robot.parameters.timing.sample_period;
        self.place();
        let table = &self.robot.receive;
        let mut frame = Frame::zeroed(0, 0, 0, false);
        for index in 0..table.message_count() {
            if table.encode(index, &self.values, &mut frame) {
                frame.stamp_ns = now;
                rx.push(frame);
            }
        }
        Ok(())
    }

    fn take(&mut self, tx: &Frames) {
        let n = self.robot.parameters.joints.len();
        let table = &self.robot.send;
        for frame in tx.iter() {
            let Ok(Some(index)) = table.decode(frame, &mut self.commands) else {
                continue;
            };
            for slot in table.slots(index) {
                let Some(&value) = self.commands.get(slot) else {
                    continue;
                };
                match slots::sent(slot) {
                    Sent::Command(joint) => self.sent[joint] = value,
                    Sent::Control(joint) => self.sent[n + joint] = value,
                }
            }
        }
    }

    fn body(&self) -> Body {
        self.body
    }
}

impl Drop for Mujoco {
    fn drop(&mut self) {
        // Its standard input closes, which ends it.
        self.child.stdin = None;
        let _ = self.child.wait();
    }
}
