//! Logs of arms drawn at random, slow to fast and with little to much noise, sound or with one of sixteen
//! contradictions: no URDF is written of masses far from the arm's beyond what a sound log of it gives.

#[path = "arms/changes.rs"]
mod changes;
#[path = "arms/drawn.rs"]
mod drawn;

use changes::CHANGES;
use drawn::Drawn;
use identification::inertia::{Calibration, consistent};
use nalgebra::DVector;
use std::fmt::Write as _;
use test_support::Random;

/// Ratios of masses that are counted.
const RATIOS: [f64; 3] = [1.5, 2.0, 3.0];

/// Counts of one kind of log.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    all: usize,
    refused: usize,
    /// Written with a mass beyond each of [`RATIOS`], and beyond that times what the sound log gives.
    off: [usize; 3],
    beyond: [usize; 3],
}

impl Counts {
    /// Counts a log by its worst ratio, none where it was refused; `sound`: that of the sound log.
    fn take(&mut self, worst: Option<f64>, sound: f64) {
        self.all += 1;
        self.refused += usize::from(worst.is_none());
        let Some(worst) = worst else { return };
        for (k, ratio) in RATIOS.into_iter().enumerate() {
            self.off[k] += usize::from(worst > ratio);
            self.beyond[k] += usize::from(worst > ratio * sound);
        }
    }

    fn sum(mut self, other: &Self) -> Self {
        self.all += other.all;
        self.refused += other.refused;
        for k in 0..3 {
            self.off[k] += other.off[k];
            self.beyond[k] += other.beyond[k];
        }
        self
    }
}

/// Errors of base parameters over their printed deviations.
fn scores(arm: &Drawn, found: &Calibration) -> Vec<f64> {
    let bodies = arm.truth.bodies()[1..].iter();
    let truth: Vec<f64> = bodies
        .flat_map(|b| {
            consistent::ten(&b.inertia)
                .iter()
                .copied()
                .collect::<Vec<_>>()
        })
        .collect();
    let truth = found.base.values(&DVector::from_vec(truth));
    let each = found.base_parameters.iter().zip(truth.iter());
    each.filter(|(own, _)| own.determined)
        .map(|(own, truth)| (own.value - truth).abs() / own.half_interval)
        .collect()
}

/// The figures of a sweep.
#[derive(Default)]
struct Sweep {
    sound: Counts,
    changed: Vec<Counts>,
    scores: Vec<f64>,
    lines: String,
}

impl Sweep {
    /// Draws arms by seeds, each sound and with every contradiction.
    fn new(seeds: std::ops::Range<u64>) -> Self {
        let mut out = Self {
            changed: vec![Counts::default(); CHANGES.len()],
            ..Self::default()
        };
        for seed in seeds {
            let arm = Drawn::new(seed);
            let sound = out.sound(&arm, seed);
            for (k, (name, change)) in CHANGES.iter().enumerate() {
                let log = change(&arm, &mut Random::new(seed ^ 0xc4a));
                let found = arm.calibrate(&log);
                let written = found.as_ref().ok().filter(|f| f.contradictions.is_empty());
                let worst = written.map(|found| arm.worst(found));
                out.changed[k].take(worst, sound);
                if let Some(worst) = worst.filter(|w| *w > RATIOS[0] * sound) {
                    let (noise, pace) = (100.0 * arm.noise, arm.pace);
                    let _ = writeln!(
                        out.lines,
                        "seed {seed}, {name}: {worst:.2} times, {sound:.2} when sound; noise {noise:.1} %, pace {pace:.2}"
                    );
                }
            }
        }
        out
    }

    /// The sound log's worst ratio; where it is refused the URDF's own, 1.5.
    fn sound(&mut self, arm: &Drawn, seed: u64) -> f64 {
        let found = arm.calibrate(&arm.log(0.0, None));
        let reason = match &found {
            Ok(found) => found.contradictions.join("; "),
            Err(problems) => problems.to_string(),
        };
        let written = found.ok().filter(|f| f.contradictions.is_empty());
        let worst = written.as_ref().map(|found| arm.worst(found));
        self.sound.take(worst, 1.0);
        match written {
            Some(found) => self.scores.extend(scores(arm, &found)),
            None => {
                let (noise, pace) = (100.0 * arm.noise, arm.pace);
                let _ = writeln!(
                    self.lines,
                    "seed {seed}, SOUND refused; noise {noise:.1} %, pace {pace:.2}: {reason}"
                );
            }
        }
        worst.unwrap_or(1.5)
    }

    fn all(&self) -> Counts {
        self.changed.iter().fold(Counts::default(), Counts::sum)
    }

    /// Share of base parameters within their 95 % interval.
    fn covered(&self) -> f64 {
        let inside = self.scores.iter().filter(|z| **z <= 1.0).count();
        inside as f64 / self.scores.len().max(1) as f64
    }

    fn table(&self) -> String {
        let mut out = format!(
            "{:36} {:>5} {:>8}  off by 1.5, 2, 3    beyond the sound log's\n",
            "log", "all", "refused"
        );
        let mut line = |name: &str, c: &Counts| {
            let Counts {
                all,
                refused,
                off: [a, b, d],
                beyond: [e, f, g],
            } = c;
            let _ = writeln!(
                out,
                "{name:36} {all:>5} {refused:>8} {a:>6} {b:>5} {d:>5} {e:>8} {f:>5} {g:>5}"
            );
        };
        line("sound", &self.sound);
        for ((name, _), counts) in CHANGES.iter().zip(&self.changed) {
            line(name, counts);
        }
        line("all contradictions", &self.all());
        let (n, inside) = (self.scores.len(), 100.0 * self.covered());
        let _ = writeln!(
            out,
            "{inside:.1} % of {n} base parameters within their 95 % interval"
        );
        out + &self.lines
    }
}

/// The sweep's figures; `SEEDS=FROM..TO` draws other arms.
#[test]
#[ignore = "takes many minutes: cargo test -p identification --test all arms:: -- --ignored --nocapture"]
#[expect(
    clippy::disallowed_macros,
    reason = "the figures are for the documents"
)]
fn few_contradictory_logs_give_masses_far_off() {
    // Seeds that no rule was designed with.
    let seeds = std::env::var("SEEDS").unwrap_or("70000..70040".into());
    let (from, to) = seeds.split_once("..").unwrap();
    let sweep = Sweep::new(from.parse().unwrap()..to.parse().unwrap());
    println!("{}", sweep.table());
    let all = sweep.all();
    let many = all.beyond[1] * 100 > all.all || all.beyond[2] * 500 > all.all;
    assert!(
        !many && sweep.sound.refused * 20 <= sweep.sound.all && sweep.covered() > 0.88,
        "{all:?}"
    );
}

/// Arms of which a log says little about a mass: its torques are explained as well by its neighbours'. Ratios of 2.95,
/// 1.98 and 1.74 were written while the divergence alone held the masses.
#[test]
fn masses_that_torques_hardly_show_stay_near_the_urdfs() {
    for seed in [1022, 1023, 1051] {
        let arm = Drawn::new(seed);
        let found = arm.calibrate(&arm.log(0.0, None)).unwrap();
        let worst = arm.worst(&found);
        assert!(worst < 1.6, "seed {seed}: {worst}");
    }
}

/// A payload in the hand for half of the log, or a delay under noise: the contradiction is named with its size.
#[test]
fn payloads_and_delays_under_noise_are_named() {
    let cases = [
        (1010, 0.0, Some(1500), "more from some t = 15"),
        (1018, 0.0, Some(1500), "more from some t = 15"),
        (1020, 0.0, Some(1500), "more from some t = 15"),
        (1001, 0.02, None, "tau is late against q by some 2"),
        (1014, 0.02, None, "tau is late against q by some 2"),
    ];
    for (seed, late, loaded_from, words) in cases {
        let arm = Drawn::new(seed);
        let said = match arm.calibrate(&arm.log(late, loaded_from)) {
            Ok(found) => found.contradictions.join("; "),
            Err(problems) => problems.to_string(),
        };
        assert!(said.contains(words), "seed {seed}: {said}");
    }
}

/// A recorder that ran at another rate than its stamps say: velocities are wrong by it, accelerations by its square.
#[test]
fn stamps_of_another_scale_are_named() {
    for (seed, factor) in [(70_000, "1.25 s"), (70_004, "0.8 s"), (70_013, "2 s")] {
        let arm = Drawn::new(seed);
        let changes = CHANGES.iter().find(|(name, _)| name.starts_with("stamps"));
        let (_, change) = changes.unwrap();
        let log = change(&arm, &mut Random::new(seed ^ 0xc4a));
        let said = arm.calibrate(&log).unwrap_err().to_string();
        assert!(
            said.contains("stamps") && said.contains(factor),
            "{seed}: {said}"
        );
    }
}
