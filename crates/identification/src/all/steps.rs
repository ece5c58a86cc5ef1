//! Each fit, and what the joint file takes over from it.

use super::ranges::validity;
use super::{Fitted, Harmonics};
use crate::current::MotorKnowledge;
use crate::excitation::{Determination, Excitation, Quantity};
use crate::fusion::{SourceKnowledge, Usual};
use crate::gaussian_process::{self, GpOptions};
use crate::gear::{GearFit, GearKnowledge};
use crate::learned::Progress;
use crate::log::LogRow;
use crate::network::{self, NetworkOptions};
use crate::record::Record;
use crate::{current, deformation, fusion, gear, kinematic, noise};
use estimators::deformation::AngularFrequency;
use estimators::hysteresis::{ENCODER_PARAMETERS, GearParameters, LINK_ORDERS, MOTOR_ORDERS};
use estimators::kalman::{ADDED_STATES, STATES, Transform};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::role::Role;
use estimators::set::EstimatorSet;
use joint_file::{
    ComplianceTable, CurrentTable, DeformationTable, FrictionTable, FusionTable, HysteresisTable,
    KalmanTable, SourceTable,
};
use problem::Problem;

/// Time constant of Z's low-pass (0.95 at 1 kHz), s.
const Z_TIME_CONSTANT_S: f64 = 0.0195;
/// Time constant of the low-pass behind models that fit better, s.
const SHORT_TIME_CONSTANT_S: f64 = 0.002;

/// Rounds of gear and higher harmonics.
const HARMONIC_ROUNDS: usize = 2;
/// Stiffness of a wave generator that counts as rigid, motor side, N·m/rad.
const RIGID: f64 = 1e9;
/// Largest error that a correction beyond G's may leave on held-out blocks, over the error
/// without it: away from its data a correction is worse than none.
const MAX_CORRECTED_RATIO: f64 = 0.8;

impl Fitted {
    fn pole(&self, time_constant_s: f64) -> f64 {
        (-self.joint.sample_period() / time_constant_s).exp()
    }

    pub(super) fn kinematic_error(&mut self, record: &Record) -> Result<(), Problem> {
        let fit = kinematic::fit(record)?;
        self.note(format!(
            "kinematic error: largest {:.1} urad, {:.2} urad RMS left",
            1e6 * (fit.parameters.bound() - fit.parameters.a0.abs()),
            1e6 * fit.rms
        ));
        self.joint.kinematic_error = Some(fit.parameters.into());
        self.turn = self.joint.kinematic_error.clone();
        Ok(())
    }

    /// A gear of the stiffness that catalogues and log agree on; its sigma holds what that leaves
    /// open at the largest torque of the log.
    fn prior_compliance(&mut self, excitation: &Excitation, constant: &Determination) {
        let compliance = constant.posterior;
        let largest = excitation.torque[0].abs().max(excitation.torque[1].abs());
        self.note(format!(
            "{}; K_fs0 {:.0} N·m/rad, within ±{:.0} %",
            constant.sentence(),
            1.0 / compliance.value,
            196.0 * compliance.sigma / compliance.value
        ));
        self.joint.compliance = Some(ComplianceTable {
            k_fs0: 1.0 / compliance.value,
            c_fs: 0.0,
            k_wg0: RIGID,
            c_wg: 0.0,
            low_pass_pole: self.pole(Z_TIME_CONSTANT_S),
            torsion_sigma: (compliance.sigma * largest).hypot(excitation.torsion_sigma),
        });
    }

    /// Skew, zero and harmonics under load, then Z's constants without them.
    /// Constants that the log does not determine stay at their prior.
    pub(super) fn compliance(&mut self, record: &Record, train: &[LogRow]) -> Result<(), Problem> {
        let excitation = Excitation::new(record, &self.joint);
        if let Some(constant) = excitation.undetermined(Quantity::Compliance) {
            self.prior_compliance(&excitation, constant);
            return Ok(());
        }
        if let Some(constant) = excitation.undetermined(Quantity::Skew) {
            self.note(constant.sentence());
        }
        let mut skew_sigma = 0.0;
        for _ in 0..2 {
            let record = Record::new(&self.joint, train)?;
            let error = self.joint.kinematic_error_parameters();
            let fit = gear::hysteresis(&record, &error, &self.gear_knowledge())?;
            self.correct_encoders(&fit);
            skew_sigma = fit.skew.1;
        }
        let record = Record::new(&self.joint, train)?;
        let error = self.joint.kinematic_error_parameters();
        if self.gear_knowledge().turned {
            // The turn's error stays what priors are about until the gear's own fit takes over its correction.
            self.joint.kinematic_error.clone_from(&self.turn);
        }
        let motor = self.joint.wave_generator_parameters();
        let fit = gear::compliance(&record, &error, motor)?;
        let p = fit.parameters;
        self.note(format!(
            "compliance: K_fs0 {:.0} N·m/rad, C_fs {:.4} /(N·m), {:.2} urad RMS left",
            p.k_fs0,
            p.c_fs,
            1e6 * fit.rms
        ));
        self.joint.compliance = Some(ComplianceTable {
            k_fs0: p.k_fs0,
            c_fs: p.c_fs,
            k_wg0: p.k_wg0,
            c_wg: p.c_wg,
            low_pass_pole: self.pole(Z_TIME_CONSTANT_S),
            torsion_sigma: fit.rms,
        });
        let skew = self.joint.encoders.as_ref().map_or(0.0, |e| e.skew);
        self.note(format!(
            "skew: motor-side encoder {:.4} ms later than the link-side one (95 % within ±{:.4} ms)",
            1e3 * skew,
            1.96e3 * skew_sigma
        ));
        Ok(())
    }

    /// Knowledge of the gear by data sheet and earlier steps.
    fn gear_knowledge(&self) -> GearKnowledge {
        let joint = &self.joint.joint;
        let error = self.joint.kinematic_error.clone().unwrap_or_default();
        let turned = self.joint.encoders.as_ref().is_none_or(|e| !e.zero_unknown)
            && self.joint.kinematic_error.is_some();
        let mut found = [0.0; ENCODER_PARAMETERS];
        found[0] = self.joint.encoders.as_ref().map_or(0.0, |e| e.skew);
        // After a turn the priors are about what the turn has shown, however often the gear is fitted.
        let none = joint.no_kinematic_error();
        let known = self.turn.as_ref().filter(|_| turned).unwrap_or(&none);
        if turned {
            found[1] = error.a0 - known.a0;
        }
        let wave = |list: &[(f64, f64)], known: &[(f64, f64)], order: u32| {
            let at =
                |list: &[(f64, f64)]| list.get(order as usize - 1).copied().unwrap_or_default();
            let (now, known) = (at(list), at(known));
            [now.0 - known.0, now.1 - known.1]
        };
        let link = (LINK_ORDERS.iter()).flat_map(|n| wave(&error.link, &known.link, *n));
        let motor = (MOTOR_ORDERS.iter()).flat_map(|n| wave(&error.motor, &known.motor, *n));
        for (found, amplitude) in found[2..].iter_mut().zip(link.chain(motor)) {
            *found = amplitude;
        }
        GearKnowledge {
            rated_torque: joint.rated_torque,
            stiffness: joint.stiffness,
            turned,
            sample_period: self.joint.sample_period(),
            found,
            reference: self.reference,
        }
    }

    /// Takes over what the gear's fit found out about the encoders.
    fn correct_encoders(&mut self, fit: &GearFit) {
        let longest = 16.0 * self.joint.sample_period();
        let encoders = self.joint.encoders.get_or_insert_default();
        encoders.skew = (encoders.skew + fit.skew.0).clamp(-longest, longest);
        let turned = self.joint.kinematic_error.is_some();
        let none = self.joint.joint.no_kinematic_error();
        let error = self.joint.kinematic_error.get_or_insert(none);
        if !turned {
            // Without an unloaded turn nothing shows whether the encoders' zeros stay.
            encoders.zero_unknown = true;
        }
        error.a0 += fit.zero.0;
        let mut waves = fit.waves.chunks_exact(2);
        for (list, orders) in [
            (&mut error.link, &LINK_ORDERS[..]),
            (&mut error.motor, &MOTOR_ORDERS[..]),
        ] {
            for (order, wave) in orders.iter().zip(&mut waves) {
                let place = *order as usize - 1;
                if list.len() <= place {
                    list.resize(place + 1, (0.0, 0.0));
                }
                list[place].0 += wave[0];
                list[place].1 += wave[1];
            }
        }
    }

    /// D3 on the link side; Z's friction is the same on the motor side.
    pub(super) fn current(&mut self, record: &Record) -> Result<(), Problem> {
        let n = self.joint.joint.gear_ratio;
        let known = MotorKnowledge {
            torque_constant: n * self.joint.joint.torque_constant,
            inertia: n * n * self.joint.joint.rotor_inertia,
            rated_torque: self.joint.joint.rated_torque,
            torque_limit: self.joint.torque_limit(),
            reference: self.reference,
        };
        let fit = current::fit(record, &known)?;
        let p = fit.parameters;
        self.joint.friction = Some(FrictionTable {
            coulomb: p.k_3 / n,
            viscous: p.k_2 / (n * n),
            epsilon: 2.0 * p.sign_smoothing * n,
            published: false,
        });
        self.note(format!(
            "current: K1 {:.4} N·m/A (95 % within ±{:.4}), friction {:.3} N·m + {:.1} % of the torque, offset {:.4} A, \
             {:.3} N·m on held-out blocks",
            p.k_1,
            1.96 * fit.sigma_1,
            p.k_3,
            100.0 * p.k_4,
            p.offset,
            p.sigma
        ));
        self.joint.current = Some(CurrentTable {
            k_1: p.k_1,
            k_2: p.k_2,
            k_3: p.k_3,
            k_4: p.k_4,
            inertia: p.inertia,
            offset: p.offset,
            sign_smoothing: p.sign_smoothing,
            presliding: (p.presliding.into_iter())
                .filter(|(_, share)| *share > 0.0)
                .collect(),
            low_pass_pole: p.low_pass_pole,
            sigma: p.sigma,
            uncertainty: fit.uncertainty,
        });
        self.joint.validity = Some(validity(record, fit.seconds));
        Ok(())
    }

    /// The gear beside what is known of the encoders, which takes over what the fit adds to that.
    fn gear(&mut self, rows: &[LogRow]) -> Result<GearFit, Problem> {
        let record = Record::new(&self.joint, rows)?;
        let error = self.joint.kinematic_error_parameters();
        let fit = gear::hysteresis(&record, &error, &self.gear_knowledge())?;
        self.correct_encoders(&fit);
        Ok(fit)
    }

    /// Harmonics of the kinematic error that the gear's fit leaves out.
    fn higher_harmonics(&mut self, rows: &[LogRow], fit: &GearFit) -> Result<(), Problem> {
        let record = Record::new(&self.joint, rows)?;
        let error = self.joint.kinematic_error_parameters();
        let found = kinematic::higher(&record, &error, &fit.parameters);
        let none = self.joint.joint.no_kinematic_error();
        let table = self.joint.kinematic_error.get_or_insert(none);
        for (list, waves) in [
            (&mut table.link, found.link),
            (&mut table.motor, found.motor),
        ] {
            for (order, (a, b)) in waves {
                if list.len() < order {
                    list.resize(order, (0.0, 0.0));
                }
                let wave = &mut list[order - 1];
                *wave = (wave.0 + a, wave.1 + b);
            }
        }
        Ok(())
    }

    pub(super) fn hysteresis(&mut self, rows: &[LogRow]) -> Result<(), Problem> {
        let mut fit = self.gear(rows)?;
        if self.harmonics == Harmonics::Higher {
            // Gear and harmonics in turn: each shows beside the other.
            for _ in 0..HARMONIC_ROUNDS {
                self.higher_harmonics(rows, &fit)?;
                fit = self.gear(rows)?;
            }
        }
        let record = &Record::new(&self.joint, rows)?;
        let error: KinematicErrorParameters = self.joint.kinematic_error_parameters();
        let p = fit.parameters;
        let width: f64 = p.slipping.iter().map(|s| 2.0 * s.limit * s.stiffness).sum();
        let (springs, stiffness) = (p.slipping.len(), p.linear);
        let gear = p.clone();
        let mut table = HysteresisTable::from(p);
        let typical = gear::typical_stiffness(record, &error, &gear);
        table.torsion_sigma = fit.rms / typical;
        table.uncertainty = fit.uncertainty;
        table.held_out_ratio = (fit.held_out / fit.rms.max(1e-12)).clamp(1.0, 10.0);
        let (tracking, errors) = gear::tracking(record, &error, &gear, |tracking| {
            self.joint.hysteresis_estimator(&HysteresisTable {
                tracking_poles: tracking.poles,
                tracking_sigma: tracking.sigma,
                // Errors are compared, not sigmas.
                uncertainty: Vec::new(),
                ..table.clone()
            })
        });
        table.tracking_poles = tracking.poles;
        table.tracking_sigma = tracking.sigma;
        table.torsion_sigma = errors.rms / typical;
        self.note(format!(
            "hysteresis: stiffness {stiffness:.0} N·m/rad (95 % within ±{:.0}), {springs} springs, \
             {width:.2} N·m wide, {:.4} N·m RMS left, {:.4} on held-out blocks, in the loop {:.4} N·m \
             with poles {:.2?}",
            1.96 * fit.stiffness.1,
            fit.rms,
            fit.held_out,
            errors.rms,
            tracking.poles
        ));
        self.joint.hysteresis = Some(table);
        Ok(())
    }

    pub(super) fn deformation(&mut self, record: &Record) -> Result<(), Problem> {
        let (rated, limit) = (self.joint.joint.rated_torque, self.joint.torque_limit());
        let pole = self.pole(SHORT_TIME_CONSTANT_S);
        let p = deformation::fit(record, rated, limit, AngularFrequency::Spatial, pole)?;
        self.note(format!(
            "deformation: {:.2} urad RMS left",
            1e6 * p.torsion_sigma
        ));
        self.joint.deformation = Some(DeformationTable {
            coefficients: p.coefficients,
            published_frequency: false,
            current_limit: p.current_limit,
            low_pass_pole: p.low_pass_pole,
            torsion_sigma: p.torsion_sigma,
        });
        Ok(())
    }

    pub(super) fn kalman(&mut self, record: &Record) -> Result<(), Problem> {
        let j = &self.joint.joint;
        let count = std::f64::consts::TAU / j.motor_counts_per_turn;
        let torsion = self
            .joint
            .compliance
            .as_ref()
            .map_or(1e-5, |c| c.torsion_sigma);
        // Start of the search: a load that may change by a thousandth of the rated torque and a
        // motor torque off by a thousandth in each period.
        let step = self.joint.sample_period() / j.rotor_inertia;
        let omega = (1e-3 * step * j.rated_torque / j.gear_ratio).powi(2);
        let tau = (1e-3 * j.rated_torque).powi(2);
        let slow = (1e-5 * j.rated_torque / j.gear_ratio).powi(2);
        let start = |hysteresis: bool| KalmanTable {
            process: [1e-3 * count * count, omega, tau, 1e2 * tau, slow],
            measurement: [count * count / 12.0, torsion * torsion],
            hysteresis,
        };
        let run = |table: &KalmanTable, added: bool, transform| {
            let parameters = self.joint.kalman_parameters(table)?;
            let tuned = if added {
                noise::fit::<ADDED_STATES>(record, &parameters, transform)
            } else {
                noise::fit::<STATES>(record, &parameters, transform)
            };
            Ok::<_, Problem>(KalmanTable {
                process: tuned.process,
                measurement: tuned.measurement,
                hysteresis: table.hysteresis,
            })
        };
        let linear = run(&start(false), false, Transform::Linear)?;
        let unscented = run(&start(false), false, Transform::Unscented)?;
        let added = run(&start(true), true, Transform::Unscented)?;
        self.joint.kalman = Some(linear);
        self.joint.unscented = Some(unscented);
        self.joint.unscented_added = Some(added);
        self.note("noise of the Kalman filters: tuned by the likelihood of innovations".to_owned());
        Ok(())
    }

    pub(super) fn network(
        &mut self,
        record: &Record,
        progress: Progress<'_>,
    ) -> Result<(), Problem> {
        let options = NetworkOptions::new(self.joint.torque_limit());
        let trained = network::train(record, &options, progress)?;
        self.note(format!(
            "network: layers {:?}, {:.4} N·m RMS left on held-out blocks",
            options.hidden, trained.held_out_rms
        ));
        self.joint.trained.network = Some(trained);
        Ok(())
    }

    pub(super) fn local_gp(
        &mut self,
        record: &Record,
        progress: Progress<'_>,
    ) -> Result<(), Problem> {
        for (k, base) in ["compliance", "hysteresis"].into_iter().enumerate() {
            let Some(mut model) = self.joint.gp_base(base)? else {
                return Err(Problem::new(
                    format!("local Gaussian processes correct {base:?}, which is not fitted"),
                    format!("a table [{base}]"),
                ));
            };
            let options = GpOptions::new(base, self.joint.joint.rated_torque);
            let mut half = |part: f64, what: &str| progress(0.5 * (k as f64 + part), what);
            let trained = gaussian_process::train(record, &options, model.as_mut(), &mut half)?;
            let (before, after) = trained.held_out_rms;
            self.note(format!(
                "local Gaussian processes on {base}: {} models, {before:.4} to {after:.4} N·m RMS \
                 on held-out blocks",
                trained.parameters.models.len()
            ));
            let name = format!("{base}_gp");
            if base != "compliance" && after > MAX_CORRECTED_RATIO * before {
                self.joint.local_gp.remove(&name);
                self.joint.trained.local_gp.remove(&name);
                self.note(format!("{name}: gain too small, not switched on"));
                continue;
            }
            self.joint.trained.local_gp.insert(name, trained);
        }
        Ok(())
    }

    pub(super) fn fusion(&mut self, record: &Record) -> Result<(), Problem> {
        let mut sources = EstimatorSet::new(self.joint.sources()?, None);
        let gear = self.joint.hysteresis.clone();
        let error = self.joint.kinematic_error_parameters();
        let of_gear = gear.clone().map(GearParameters::from);
        // The past before the log is a part of sigma by itself, which fades.
        let used = match &of_gear {
            Some(of_gear) => gear::past_known(record, &error, of_gear),
            None => vec![true; record.samples.len()],
        };
        let typical = of_gear.map(|of_gear| gear::typical_stiffness(record, &error, &of_gear));
        let turned = self.gear_knowledge().turned;
        let own = self.harmonics == Harmonics::Higher;
        let place = |role: Role| sources.roles().iter().position(|its| *its == role);
        let reports = place(Role::Gear);
        let known: Vec<SourceKnowledge> = (sources.roles().iter())
            .map(|role| SourceKnowledge {
                // Only models with priors know how wrong they may be away from their data.
                fused: *role != Role::Torsion || gear.is_none(),
                usual: match (role, turned) {
                    (Role::Model, _) => Usual::FEED_FORWARD,
                    (Role::Current, true) if !own => Usual::CURRENT_TURNED,
                    (Role::Current, _) => Usual::CURRENT,
                    _ if own => Usual::OWN_RECORDINGS,
                    (_, true) => Usual::TURNED,
                    (_, false) => Usual::NOT_TURNED,
                },
                own_sigma: match (role, gear.as_ref().zip(typical)) {
                    (Role::Gear, Some((gear, stiffness))) => Some(gear.torsion_sigma * stiffness),
                    _ => None,
                },
                // The filter has the same gear.
                parameters_of: reports.filter(|_| role.has_gear()),
                // Of a robot's own recordings every block moves all joints in another way: what a fit without it
                // gets wrong there is the parameters' part, which counts by itself.
                held_out_ratio: match (&gear, role) {
                    (_, Role::Current | Role::Model) | (None, _) => 1.0,
                    _ if own => 1.0,
                    (Some(gear), _) => gear.held_out_ratio,
                },
            })
            .collect();
        let torques = [self.joint.joint.rated_torque, self.joint.torque_limit()];
        let p = fusion::fit(record, &mut sources, &used, &known, torques);
        let table = |i: usize| SourceTable {
            rms: p.sources[i].errors.map(|error| error.variance.sqrt()),
            sigma: p.sources[i].errors.map(|error| error.reported),
            fused: p.sources[i].fused,
        };
        self.joint.fusion = Some(FusionTable {
            moving_rate: p.moving,
            loading_rate: p.loading,
            blend: p.blend,
            sources: (sources.names().iter().enumerate())
                .map(|(i, name)| (name.clone(), table(i)))
                .collect(),
        });
        Ok(())
    }
}
