//! Changing contacts without a step: hypotheses blend over a set time, chosen by a client or by
//! the load on the feet.

use crate::estimator::WholeBody;

/// Rule by which a sensor counts as loaded.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadRule {
    /// Force above which a sensor's part becomes loaded, N.
    pub on: f64,
    /// Force below which it becomes unloaded, N; below `on`.
    pub off: f64,
    /// Time for which the force must stay there, s.
    pub hold: f64,
}

/// Parameters of a [`ContactSwitch`].
#[derive(Debug, Clone, PartialEq)]
pub struct ContactSwitchParameters {
    /// T: time between updates, s.
    pub sample_period: f64,
    /// Time over which a hypothesis gives way to another, s.
    pub blend: f64,
    /// The automatic rule; none: clients choose.
    pub rule: Option<LoadRule>,
    /// Per hypothesis: the state of load that it belongs to, as pairs of an F/T sensor's index and
    /// whether it is loaded; the first that fits is chosen. An empty list is never chosen by itself.
    pub loaded: Vec<Vec<(usize, bool)>>,
}

/// Whether a sensor is loaded, and for how long its force has contradicted that, s.
#[derive(Debug, Clone, Copy, Default)]
struct Load {
    loaded: bool,
    contradicted_for: f64,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct ContactSwitch {
    parameters: ContactSwitchParameters,
    weights: Vec<f64>,
    target: usize,
    loads: Vec<Load>,
    automatic: bool,
}

impl ContactSwitch {
    /// For an estimator with as many hypotheses; begins with the first, and automatic if there is a
    /// rule.
    #[must_use]
    pub fn new(hypotheses: usize, sensors: usize, parameters: ContactSwitchParameters) -> Self {
        let mut weights = vec![0.0; hypotheses.max(1)];
        weights[0] = 1.0;
        Self {
            automatic: parameters.rule.is_some(),
            weights,
            target: 0,
            loads: vec![Load::default(); sensors],
            parameters,
        }
    }

    /// A client chooses; the automatic rule is off from then on. None of that index: false.
    pub fn choose(&mut self, hypothesis: usize) -> bool {
        if hypothesis >= self.weights.len() {
            return false;
        }
        (self.target, self.automatic) = (hypothesis, false);
        true
    }

    /// Returns the choice to the rule; where there is none, to the first hypothesis.
    pub fn automatic(&mut self) {
        self.automatic = self.parameters.rule.is_some();
        if !self.automatic {
            self.target = 0;
        }
    }

    /// Whether the rule chooses.
    #[must_use]
    pub fn is_automatic(&self) -> bool {
        self.automatic
    }

    /// The hypothesis that is, or becomes, the only one.
    #[must_use]
    pub fn target(&self) -> usize {
        self.target
    }

    /// Share of each hypothesis in the next update, for another estimator with the same ones.
    #[must_use]
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Whether a sensor's part is loaded.
    #[must_use]
    pub fn loaded(&self, sensor: usize) -> bool {
        self.loads.get(sensor).is_some_and(|l| l.loaded)
    }

    /// To be called once per period: reads the last estimate and sets the shares of the next.
    ///
    /// A part's net force needs no hypothesis, so a wrong one cannot keep itself alive.
    pub fn update(&mut self, whole_body: &mut WholeBody) {
        let dt = self.parameters.sample_period;
        if whole_body.estimate().valid
            && let Some(rule) = &self.parameters.rule
        {
            for (s, load) in self.loads.iter_mut().enumerate() {
                let f = whole_body.net_at_sensor(s).force;
                let force = f.iter().map(|x| x * x).sum::<f64>().sqrt();
                let contradicted = if load.loaded {
                    force < rule.off
                } else {
                    force > rule.on
                };
                load.contradicted_for = if contradicted {
                    load.contradicted_for + dt
                } else {
                    0.0
                };
                if load.contradicted_for > rule.hold {
                    *load = Load {
                        loaded: !load.loaded,
                        contradicted_for: 0.0,
                    };
                }
            }
            if self.automatic {
                let fits = |pattern: &Vec<(usize, bool)>| {
                    !pattern.is_empty()
                        && pattern.iter().all(|&(s, loaded)| {
                            self.loads.get(s).is_some_and(|l| l.loaded == loaded)
                        })
                };
                let fitting = self.parameters.loaded.iter().position(fits);
                let known = fitting.filter(|&h| h < self.weights.len());
                self.target = known.unwrap_or(self.target);
            }
        }
        self.shift(dt);
        whole_body.blend(&self.weights);
    }

    /// Moves the shares towards the target's; those of the others shrink alike.
    fn shift(&mut self, dt: f64) {
        let step = if self.parameters.blend > dt {
            dt / self.parameters.blend
        } else {
            1.0
        };
        let own = self.weights[self.target];
        let next = (own + step).min(1.0);
        let others = if own < 1.0 {
            (1.0 - next) / (1.0 - own)
        } else {
            0.0
        };
        for w in &mut self.weights {
            *w *= others;
        }
        self.weights[self.target] = next;
    }
}
