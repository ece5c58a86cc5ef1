//! A drive that was identified, beside its configuration: as text, JSON, and keys of robot.toml.

use identification::drive::{Drive, DriveKnowledge, Value};
use identification::motor::{MotorFit, Piecewise};
use robot_config::JointParameters;
use serde_json::{Value as Json, json};
use std::borrow::Cow;
use std::fmt::Write as _;
use terminal::TextTable;
use torqued_client::robot_state::JointKind;

/// Result of an identification.
pub(crate) struct Found<'a> {
    pub(crate) joint: &'a JointParameters,
    pub(crate) known: &'a DriveKnowledge,
    pub(crate) drive: &'a Drive,
    pub(crate) motor: Option<Motor>,
    pub(crate) files: Vec<String>,
}

/// A key of robot.toml in `[drive.NAME]` or a table of it, as a recording shows it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Setting {
    /// The table in the drive's own; empty for that one.
    pub(crate) table: &'static str,
    pub(crate) key: &'static str,
    pub(crate) value: f64,
    /// Half of the 95 % interval.
    pub(crate) width: f64,
    pub(crate) configured: f64,
}

/// The motor by a model of D 3.
pub(crate) enum Motor {
    Linear(MotorFit, &'static str),
    Asymmetric { newton: MotorFit, program: MotorFit },
    Piecewise(MotorFit, [Piecewise; 2]),
}

/// A value with its name and unit, as users read it.
pub(super) struct Row {
    pub(super) name: &'static str,
    pub(super) unit: Cow<'static, str>,
    pub(super) value: Value,
    /// Share of the configured value by which it must differ to be flagged.
    share: f64,
}

/// A configured value that is further away than this share, and outside of the interval, disagrees.
const SHARE: f64 = 0.1;

impl Row {
    pub(super) fn remark(&self) -> &'static str {
        match (self.value.determined, self.value.disagrees(self.share)) {
            (false, _) => "not determined",
            (true, true) => "DISAGREES",
            (true, false) => "",
        }
    }
}

impl Found<'_> {
    /// The parameters, in the units that users read.
    pub(super) fn rows(&self) -> Vec<Row> {
        let d = self.drive;
        let n = self.known.gear_ratio;
        let scaled = |value: Value, factor: f64| Value {
            value: factor * value.value,
            sigma: factor * value.sigma,
            configured: factor * value.configured,
            ..value
        };
        let kind = self.joint.kind;
        // The motor's side is in rad whatever the joint is.
        let row = |name: &'static str, unit: &'static str, value: Value, factor: f64| Row {
            name,
            unit: if name.contains("motor side") || name.contains("direction") {
                Cow::Borrowed(unit)
            } else {
                kind.units(unit)
            },
            value: scaled(value, factor),
            share: SHARE,
        };
        let mut rows = Vec::new();
        rows.extend(d.stiffness.map(|v| row("stiffness k_d", "N·m/rad", v, 1.0)));
        rows.extend(d.damping.map(|v| row("damping d_d", "N·m·s/rad", v, 1.0)));
        rows.extend(
            d.dead_zone
                .map(|v| row("dead zone", self.own("urad", "um"), v, 1e6)),
        );
        // Compared as rates, as none is no time at all.
        rows.extend(
            (d.integral
                .filter(|rate| rate.value.max(rate.configured) > 0.0))
            .map(|v| row("velocity loop's integral 1/T_i", "1/s", v, 1.0)),
        );
        rows.extend(
            d.gain
                .map(|v| row("measured over commanded current", "1", v, 1.0)),
        );
        rows.extend([
            row(
                "rotor inertia, motor side",
                "kg·mm²",
                d.inertia,
                1e6 / (n * n),
            ),
            row("delay, sample to torque", "ms", d.delay, 1e3),
            row("Coulomb friction, motor side", "mN·m", d.coulomb, 1e3 / n),
            row(
                "viscous friction, motor side",
                "uN·m·s/rad",
                d.viscous,
                1e6 / (n * n),
            ),
            row(
                "its difference by direction",
                "uN·m·s/rad",
                d.asymmetry,
                1e6 / (n * n),
            ),
            row("friction per torque carried", "%", d.load, 100.0),
        ]);
        // The configuration has no key for these: nothing to disagree with.
        for row in rows.iter_mut().rev().take(2) {
            row.share = f64::INFINITY;
        }
        rows
    }

    pub(super) fn text(&self) -> String {
        let d = self.drive;
        let mut text = format!(
            "{}: {:.1} s of {}\n\n",
            self.joint.name,
            d.seconds,
            self.files.join(", ")
        );
        let mut table = vec![
            ["", "", "found", "95 % interval", "configured", ""]
                .map(str::to_owned)
                .to_vec(),
        ];
        for row in self.rows() {
            let [least, most] = row.value.interval();
            table.push(vec![
                row.name.to_owned(),
                row.unit.to_string(),
                digits(row.value.value),
                format!("{} to {}", digits(least), digits(most)),
                digits(row.value.configured),
                row.remark().to_owned(),
            ]);
        }
        let _ = write!(text, "{}", TextTable(table));
        for line in self.lines() {
            let _ = writeln!(text, "{line}");
        }
        text
    }

    /// A unit or key of link-side quantities as this joint has it.
    fn own(&self, revolute: &'static str, prismatic: &'static str) -> &'static str {
        match self.joint.kind {
            JointKind::Revolute => revolute,
            JointKind::Prismatic => prismatic,
        }
    }

    /// Remarks and the motor's model, a line each.
    pub(super) fn lines(&self) -> Vec<String> {
        let d = self.drive;
        let shares = d
            .arrivals
            .iter()
            .enumerate()
            .filter(|(_, share)| **share > 0.02);
        let shares: Vec<String> = shares
            .map(|(periods, share)| format!("{periods}: {:.0} %", 100.0 * share))
            .collect();
        let mut lines = vec![
            String::new(),
            format!(
                "the drive's law leaves {:.1} % of the current, the rotor's equation {:.1} % of the torque",
                100.0 * d.current[1] / d.current[0],
                100.0 * d.torque[1] / d.torque[0]
            ),
            format!(
                "periods until a set-point shows in the current: {}",
                shares.join(", ")
            ),
        ];
        lines.extend(d.notes.iter().map(|note| format!("note: {note}")));
        if let Some(motor) = &self.motor {
            lines.push(String::new());
            lines.extend(self.motor_lines(motor));
        }
        lines
    }

    fn motor_lines(&self, motor: &Motor) -> Vec<String> {
        let line = |fit: &MotorFit, name: &str| {
            let values = self.constants(fit);
            let parts = values.iter().map(|(name, value, sigma, unit)| {
                format!(
                    "{name} = {} ± {} {unit}",
                    digits(*value),
                    digits(1.96 * sigma)
                )
            });
            let parts: Vec<String> = parts.collect();
            format!(
                "{name}: {}; {:.0} % of {} rows over-estimated",
                parts.join(", "),
                100.0 * fit.over,
                fit.rows
            )
        };
        match motor {
            Motor::Linear(fit, name) => vec![line(fit, name)],
            Motor::Asymmetric { newton, program } => vec![
                line(newton, "asymmetric penalty, Newton (D8)"),
                line(program, "asymmetric penalty, quadratic program (D9)"),
            ],
            Motor::Piecewise(linear, sides) => {
                let mut lines = vec![line(linear, "least squares, for k_v")];
                for (side, name) in sides.iter().zip(["forwards", "backwards"]) {
                    let slopes: Vec<String> = side.lines.iter().map(|(s, _)| digits(*s)).collect();
                    let [a, b] = side.breaks;
                    let rest = if side.converged {
                        ""
                    } else {
                        " (the breaks did not come to rest)"
                    };
                    lines.push(format!(
                        "piecewise, {name}: slopes {}, breaks at {} and {} {}{rest}",
                        slopes.join(", "),
                        digits(a),
                        digits(b),
                        self.own("N·m", "N")
                    ));
                }
                lines
            }
        }
    }

    /// K_tau, K_v, K_c of a position drive, or K1, K2, K3 of one that takes currents: value, sigma, unit.
    fn constants(&self, fit: &MotorFit) -> [(&'static str, f64, f64, &'static str); 3] {
        let ([a, b, c], [sa, sb, sc]) = (fit.x, fit.sigma);
        match self.known.takes_position {
            true => [
                ("K_tau", a, sa, self.own("rad/(N·m)", "m/N")),
                ("K_v", b, sb, "s"),
                ("K_c", c, sc, self.own("rad", "m")),
            ],
            // D3 solved for i: 1/K1, K2/K1, K3/K1.
            false => {
                let over = |x: f64, s: f64| (x / a).abs() * (s / x).hypot(sa / a);
                [
                    (
                        "K1",
                        1.0 / a,
                        (sa / (a * a)).abs(),
                        self.own("N·m/A", "N/A"),
                    ),
                    ("K2", b / a, over(b, sb), self.own("N·m·s/rad", "N·s/m")),
                    ("K3", c / a, over(c, sc), self.own("N·m", "N")),
                ]
            }
        }
    }

    pub(super) fn json(&self) -> Json {
        let rows: Vec<Json> = (self.rows().iter())
            .map(|row| {
                let v = &row.value;
                json!({
                    "name": row.name, "unit": row.unit, "value": v.value, "sigma": v.sigma,
                    "interval_95": v.interval(), "configured": v.configured,
                    "determined": v.determined, "disagrees": v.disagrees(row.share),
                })
            })
            .collect();
        let motor = self.motor.as_ref().map(|motor| {
            let fit = |fit: &MotorFit| {
                let constants = self.constants(fit).map(|(name, value, sigma, unit)| {
                    json!({ "name": name, "value": value, "sigma": sigma, "unit": unit })
                });
                json!({ "constants": constants, "rms": fit.rms, "over_estimated": fit.over, "rows": fit.rows })
            };
            match motor {
                Motor::Linear(one, _) => fit(one),
                Motor::Asymmetric { newton, program } => {
                    json!({ "newton": fit(newton), "quadratic_program": fit(program) })
                }
                Motor::Piecewise(one, sides) => {
                    let sides = sides.map(|s| {
                        json!({ "lines": s.lines, "breaks_Nm": s.breaks, "converged": s.converged })
                    });
                    json!({ "linear": fit(one), "forwards": sides[0], "backwards": sides[1] })
                }
            }
        });
        let object = json!({
            "joint": self.joint.name, "drive": self.joint.drive, "recordings": self.files,
            "seconds": self.drive.seconds, "parameters": rows, "arrivals": self.drive.arrivals,
            "current_rms_A": self.drive.current[0], "current_rest_A": self.drive.current[1],
            "torque_rms_Nm": self.drive.torque[0], "torque_rest_Nm": self.drive.torque[1],
            "motor": motor, "notes": self.drive.notes,
        });
        crate::units::keys(self.joint.kind, object)
    }

    /// The keys of robot.toml that the recording determines.
    pub(crate) fn settings(&self) -> Vec<Setting> {
        let (d, n) = (self.drive, self.known.gear_ratio);
        let mut all = Vec::new();
        let mut key = |table, key, of: &Value, shown: &dyn Fn(f64) -> f64| {
            let (value, configured) = (shown(of.value), shown(of.configured));
            let [least, most] = of.interval();
            let width = (most - least) / 2.0 * (value / of.value).abs();
            if of.determined && value > 0.0 {
                all.push(Setting {
                    table,
                    key,
                    value,
                    width,
                    configured,
                });
            }
        };
        let plain = |x: f64| x;
        key("", "rotor_inertia_kg_m2", &d.inertia, &|x| x / (n * n));
        key("friction", "coulomb_Nm", &d.coulomb, &|x| x / n);
        key("friction", "viscous_Nms_per_rad", &d.viscous, &|x| {
            x / (n * n)
        });
        if let (None, Some(k), Some(c)) = (self.motor_fit(), &d.stiffness, &d.damping) {
            // K_tau is the softness of drive and gear in series (control.md); the gear's stays. Over the
            // motor's angle there is no gear.
            let gear = if self.joint.has_link_encoder {
                1.0 / self.joint.law.gear.k_fs0
            } else {
                0.0
            };
            key(
                "motor",
                self.own("K_tau_rad_per_Nm", "K_tau_m_per_N"),
                k,
                &|x| 1.0 / x + gear,
            );
            let ratio = Value {
                value: c.value / k.value,
                sigma: c.sigma / k.value,
                configured: c.configured / k.configured,
                ..*c
            };
            key("motor", "K_v_s", &ratio, &plain);
        }
        if let Some(zone) = &d.dead_zone {
            key(
                "motor",
                self.own("dead_zone_rad", "dead_zone_m"),
                zone,
                &plain,
            );
        }
        if let Some(rate) = d.integral.filter(|rate| rate.value > 0.0) {
            let time = |rate: f64| 1e3 / rate;
            key("motor", "integral_time_ms", &rate, &time);
        }
        if let Some(fit) = self.motor_fit() {
            let fitted = self.motor_keys().into_iter().zip(self.constants(fit));
            all.extend(fitted.filter(|(_, (_, value, ..))| *value > 0.0).map(
                |(key, (_, value, sigma, _))| Setting {
                    table: "motor",
                    key,
                    value,
                    width: 1.96 * sigma,
                    configured: f64::NAN,
                },
            ));
        }
        all
    }

    /// The same as lines of robot.toml.
    pub(super) fn toml(&self) -> String {
        let name = &self.joint.drive;
        let mut text = format!(
            "# Keys of robot.toml to change, from joint {} in {}.\n\
             # All joints of the kind {name:?} share them: compare joints before one's values are adopted.\n",
            self.joint.name,
            self.files.join(", ")
        );
        let delay = &self.drive.delay;
        if delay.determined {
            let _ = writeln!(
                text,
                "# [control] command_delay_us + [drive.{name}] command_lag_us: {} ± {}, configured {}",
                digits(1e6 * delay.value),
                digits(1.96e6 * delay.sigma),
                digits(1e6 * delay.configured)
            );
        }
        let settings = self.settings();
        for table in ["", "friction", "motor"] {
            let dot = if table.is_empty() { "" } else { "." };
            let _ = write!(text, "\n[drive.{name}{dot}{table}]\n");
            for s in settings.iter().filter(|s| s.table == table) {
                let (value, width) = (digits(s.value), digits(s.width));
                let _ = writeln!(text, "{} = {value}  # 95 %: ± {width}", s.key);
            }
        }
        text
    }

    fn motor_fit(&self) -> Option<&MotorFit> {
        match self.motor.as_ref()? {
            Motor::Linear(fit, _) | Motor::Asymmetric { newton: fit, .. } => Some(fit),
            // The law takes no piecewise model.
            Motor::Piecewise(..) => None,
        }
    }

    fn motor_keys(&self) -> [&'static str; 3] {
        if self.known.takes_position {
            [
                self.own("K_tau_rad_per_Nm", "K_tau_m_per_N"),
                "K_v_s",
                self.own("K_c_rad", "K_c_m"),
            ]
        } else {
            [
                self.own("K_1_Nm_per_A", "K_1_N_per_A"),
                self.own("K_2_Nms_per_rad", "K_2_Ns_per_m"),
                self.own("K_3_Nm", "K_3_N"),
            ]
        }
    }
}

/// Four significant digits.
pub(crate) fn digits(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    let decimals = 3 - x.abs().log10().floor() as i32;
    match decimals {
        0..=9 => format!("{x:.*}", decimals as usize),
        ..0 => format!("{x:.0}"),
        _ => format!("{x:.3e}"),
    }
}
