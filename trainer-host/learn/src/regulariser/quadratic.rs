//! A quadratic penalty around one running anchor: a center that the policy is regularised towards, each parameter as
//! strongly as earlier tasks need it.
//!
//! After task `l` the objective keeps of it the quadratic `gᵀ(θ − θ_l) − ½ (θ − θ_l)ᵀ H (θ − θ_l)`. All those of earlier
//! tasks add up to one, `− ½ (θ − c)ᵀ S (θ − c)` with `S = Σ H` and a center `c`, whatever their number: that is the
//! whole state. With the gradients `g` kept, `c` is the newest policy (corrected IL-SOAR, which is online EWC); without
//! them it is the weighted mean of all (EWC, with its double counting).

use kestrel_config::{ConfigError, Field, Limits};
use kestrel_core::anchor::Anchor;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::curvature::{fisher, sensitivity};
use super::kronecker::Kronecker;
use super::{EndedTask, Learning, OptimiserStep, Regulariser, check_number};
use crate::actor_critic::{Actor, Gradient};
use crate::network::dot;

/// Added to each normalised curvature: parameters that a task does not use at all stay a little where they are.
const DAMPING: f32 = 0.01;

/// Greatest strength that a budget comes to.
const STRENGTH_LIMIT: f32 = 1e2;

/// How an anchor is made and how it penalties.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct QuadraticSettings {
    /// What stands for the curvature `H` of a task's objective.
    #[serde(default)]
    pub curvature: Curvature,
    /// What is kept of the gradient `g` of a task's objective at its end.
    #[serde(default)]
    pub gradient: GradientTerm,
    /// How the penalty reaches the policy.
    #[serde(default)]
    pub coupling: Coupling,
    /// How strong it is.
    pub strength: Strength,
    /// Share of the importance of all earlier tasks that is kept when another is added; 1 for corrected IL-SOAR.
    #[serde(default = "super::one")]
    pub decay: f32,
}

/// What stands for the curvature of a task's objective.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Curvature {
    /// The same for all parameters.
    Identity,
    /// Diagonal of the policy's Fisher information, exact in the action, divided by its mean.
    #[default]
    Fisher,
    /// Sensitivity of the squared length of the action (MAS), divided by its mean.
    Sensitivity,
    /// The policy's Fisher information with what holds between the weights of a layer (K-FAC), divided by the mean of its
    /// diagonal; needs `gradient: balance` and `coupling: gradient`.
    Kronecker,
}

/// What is kept of the gradient of a task's objective at its end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GradientTerm {
    /// Nothing: the center is the weighted mean of all policies (EWC).
    Absent,
    /// As measured on a rollout of its own.
    Measured,
    /// The force that balances the penalty's own, as at a stationary point: the center is the newest policy (online EWC).
    #[default]
    Balance,
}

/// How the penalty reaches the policy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Coupling {
    /// Added to the gradient, before that is clipped and Adam scales it.
    #[default]
    Gradient,
    /// As an implicit step after Adam's.
    Proximal,
}

/// How strong the penalty is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Strength {
    /// This factor: on curvatures whose mean is one, or on a mean divergence.
    Fixed(f32),
    /// As much as keeps the policy within this much divergence \[nat\]: with an anchor, which predicts it for each
    /// earlier task, the square of the share used; with states, on which its mean is measured, a multiplier that rises
    /// outside and falls inside.
    #[serde(rename = "budget_nats")]
    Budget(f32),
}

impl Strength {
    pub(super) fn check(self, field: &Field<'_>) -> Result<(), ConfigError> {
        let (key, strength) = match self {
            Self::Fixed(strength) => ("fixed", strength),
            Self::Budget(nats) => ("budget_nats", nats),
        };
        check_number(field, key, strength, &Limits::above(0.0, 1e6, ""))
    }
}

impl QuadraticSettings {
    pub(super) fn check(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        if self.curvature == Curvature::Kronecker {
            if self.gradient != GradientTerm::Balance {
                return Err(field.at("gradient").reject("another term", "balance, with the curvature kronecker"));
            }
            if self.coupling != Coupling::Gradient {
                return Err(field.at("coupling").reject("proximal", "gradient, with the curvature kronecker"));
            }
        }
        self.strength.check(&field.at("strength"))?;
        check_number(field, "decay", self.decay, &Limits::from(0.0, 1.0, ""))
    }
}

/// The anchor of all tasks so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct QuadraticPenalty {
    settings: QuadraticSettings,
    /// Of the network's parameters, without those of the standard deviation.
    center: Vec<f32>,
    importance: Importance,
    tasks: u32,
    strength: f32,
    /// Mean curvature of the tasks, by which theirs were divided \[nat\].
    unit: f32,
}

/// `S`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Importance {
    /// The same for all.
    Uniform(f32),
    /// One each.
    Diagonal(Vec<f32>),
    /// A matrix per layer.
    Kronecker(Kronecker),
}

impl QuadraticPenalty {
    pub(super) fn new(settings: &QuadraticSettings, Learning { actor, .. }: Learning<'_>) -> Self {
        let parameters = actor.mlp().parameter_count();
        Self {
            settings: *settings,
            center: vec![0.0; parameters],
            importance: match settings.curvature {
                Curvature::Identity => Importance::Uniform(0.0),
                Curvature::Fisher | Curvature::Sensitivity => Importance::Diagonal(vec![0.0; parameters]),
                Curvature::Kronecker => Importance::Kronecker(Kronecker::new(actor.mlp())),
            },
            tasks: 0,
            strength: match settings.strength {
                Strength::Fixed(strength) => strength,
                Strength::Budget(_) => 1.0,
            },
            unit: 0.0,
        }
    }

    /// Strength of the penalty at present.
    pub fn strength(&self) -> f32 {
        self.strength
    }

    /// Divergence \[nat\] from what was learned that the quadratic predicts for a policy, over all earlier tasks.
    pub fn divergence(&mut self, actor: &Actor) -> f32 {
        let parameters = &actor.parameters()[..self.center.len()];
        let quadratic = match &mut self.importance {
            Importance::Uniform(each) => {
                let distances = parameters.iter().zip(&self.center).map(|(now, center)| now - center);
                0.5 * *each * distances.map(|distance| distance * distance).sum::<f32>()
            }
            Importance::Diagonal(importance) => {
                Anchor { center: &mut self.center, importance }.divergence(parameters)
            }
            Importance::Kronecker(layers) => {
                let away = displacement(parameters, &self.center);
                0.5 * dot(&away, &layers.times(&away))
            }
        };
        self.unit * quadratic
    }

    /// With a budget the penalty is as strong as the square of the share of it that the policy has used: hardly felt far
    /// below, and as strong as the curvature itself at its end. It needs no memory and no rate.
    fn update_strength(&mut self, actor: &Actor) {
        if let Strength::Budget(nats) = self.settings.strength {
            let used = self.divergence(actor) / (nats * self.tasks as f32);
            self.strength = (used * used).min(STRENGTH_LIMIT);
        }
    }

    /// The measured gradient of the objective, in units of the penalty; zero where it is not kept.
    fn gradient_offset(&self, ended: &EndedTask<'_>) -> Vec<f32> {
        let kept = match self.settings.gradient {
            GradientTerm::Measured => 1.0,
            GradientTerm::Absent | GradientTerm::Balance => 0.0,
        };
        // What is measured is the gradient of a loss, which points away from what the task wants.
        let share = -kept / self.strength.max(1.0 / STRENGTH_LIMIT);
        ended.gradient[..self.center.len()].iter().map(|value| share * value).collect()
    }
}

impl Regulariser for QuadraticPenalty {
    fn stored_bytes(&self) -> usize {
        let importance = match &self.importance {
            Importance::Uniform(_) => 1,
            Importance::Diagonal(values) => values.len(),
            Importance::Kronecker(layers) => layers.len(),
        };
        // Beside them the number of tasks, the strength and the unit.
        4 * (self.center.len() + importance + 3)
    }

    fn add_gradient(&mut self, Learning { actor, .. }: Learning<'_>, gradient: &mut Gradient) {
        if self.tasks == 0 || self.settings.coupling != Coupling::Gradient {
            return;
        }
        self.update_strength(actor);
        let count = self.center.len();
        let (parameters, gradient) = (&actor.parameters()[..count], &mut gradient.actor[..count]);
        match &mut self.importance {
            Importance::Uniform(each) => {
                let penalty = self.strength * *each;
                for ((gradient, now), center) in gradient.iter_mut().zip(parameters).zip(&self.center) {
                    *gradient += penalty * (now - center);
                }
            }
            Importance::Diagonal(importance) => {
                Anchor { center: &mut self.center, importance }.add_penalty_gradient(
                    parameters,
                    self.strength,
                    gradient,
                );
            }
            Importance::Kronecker(layers) => {
                let force = layers.times(&displacement(parameters, &self.center));
                for (gradient, force) in gradient.iter_mut().zip(force) {
                    *gradient += self.strength * force;
                }
            }
        }
    }

    fn after_step(&mut self, actor: &mut Actor, step: &OptimiserStep<'_>) {
        if self.tasks == 0 || self.settings.coupling != Coupling::Proximal {
            return;
        }
        self.update_strength(actor);
        let parameters = &mut actor.parameters_mut()[..self.center.len()];
        let rate = step.learning_rate * self.strength;
        match &mut self.importance {
            Importance::Uniform(each) => {
                let share = rate * *each / (1.0 + rate * *each);
                for (now, center) in parameters.iter_mut().zip(&self.center) {
                    *now += share * (center - *now);
                }
            }
            Importance::Diagonal(importance) => {
                Anchor { center: &mut self.center, importance }.proximal_step(parameters, rate);
            }
            Importance::Kronecker(_) => unreachable!("its settings couple it by the gradient"),
        }
    }

    fn consolidate(&mut self, ended: &EndedTask<'_>) {
        self.tasks += 1;
        let gradient_offset = self.gradient_offset(ended);
        let parameters = &ended.actor.parameters()[..self.center.len()];
        let QuadraticSettings { curvature, gradient, decay, .. } = self.settings;
        let newest = match &mut self.importance {
            Importance::Uniform(each) => {
                *each = decay * *each + 1.0;
                let share = match gradient {
                    GradientTerm::Balance => 1.0,
                    GradientTerm::Absent | GradientTerm::Measured => 1.0 / *each,
                };
                for ((center, now), gradient_offset) in self.center.iter_mut().zip(parameters).zip(gradient_offset)
                {
                    *center += share * (now - *center) + gradient_offset / *each;
                }
                mean(&fisher(ended.actor, ended.visited))
            }
            Importance::Diagonal(importance) => {
                let information = fisher(ended.actor, ended.visited);
                let newest = mean(&information);
                let is_sensitivity = curvature == Curvature::Sensitivity;
                let curvature =
                    normalised(if is_sensitivity { sensitivity(ended.actor, ended.visited) } else { information });
                let mut anchor = Anchor { center: &mut self.center, importance };
                match gradient {
                    GradientTerm::Balance => anchor.consolidate_at(parameters, &curvature, decay),
                    GradientTerm::Absent | GradientTerm::Measured => {
                        anchor.consolidate(parameters, &curvature, decay);
                        anchor.newton_step(&gradient_offset);
                    }
                }
                newest
            }
            Importance::Kronecker(layers) => {
                let information = Kronecker::measured(ended.actor, ended.visited);
                layers.add(&information, self.tasks, decay);
                self.center.copy_from_slice(parameters);
                information.mean()
            }
        };
        self.unit += (newest - self.unit) / self.tasks as f32;
    }
}

/// Divided by its mean, so that no task weighs more because its policy is steeper, and damped.
fn normalised(curvature: Vec<f32>) -> Vec<f32> {
    let mean = mean(&curvature).max(f32::MIN_POSITIVE);
    curvature.into_iter().map(|value| value / mean + DAMPING).collect()
}

fn displacement(now: &[f32], center: &[f32]) -> Vec<f32> {
    now.iter().zip(center).map(|(now, center)| now - center).collect()
}

fn mean(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len() as f32
}
