//! IL-SOAR as the thesis wrote it and as its public code computed it: for the record, not for use.
//!
//! The thesis adds `+ L/2 ‖θ − θ_l‖²` to an objective that it maximises, which repels the policy from its anchors. Both
//! versions of the code are wrong in other ways, and their running means are none.

use kestrel_config::{ConfigError, Field};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{EndedTask, Learning, OptimiserStep, Regulariser, STRENGTH, check_number};
use crate::actor_critic::{Actor, Gradient};

/// How an earlier policy and its gradient enter the gradient of the loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SoarRule {
    /// Equation 3.8, as a loss: `+ w g − L (θ − mean θ_l)`; means are means.
    Literal,
    /// The code of October 2022: `+ w g + L |θ − a|`, each parameter pushed down; sums for means.
    Absolute,
    /// The code's last version, November 2022: `− (w g + L (θ − a))`; sums for means.
    Head,
}

/// IL-SOAR as published.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReferenceSoarSettings {
    /// Which of its forms.
    pub rule: SoarRule,
    /// Weight of the old gradient, `w`.
    pub gradient_weight: f32,
    /// `L`.
    pub curvature: f32,
}

impl ReferenceSoarSettings {
    pub(super) fn check(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        check_number(field, "gradient_weight", self.gradient_weight, &STRENGTH)?;
        check_number(field, "curvature", self.curvature, &STRENGTH)
    }
}

/// What the method remembers: one policy and one gradient, of actor, standard deviations and critic.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceSoar {
    settings: ReferenceSoarSettings,
    anchor: Vec<f32>,
    gradient: Vec<f32>,
    /// The gradient of the last minibatch, its penalty included, after it was clipped.
    last: Vec<f32>,
    tasks: u32,
}

impl ReferenceSoar {
    pub(super) fn new(settings: &ReferenceSoarSettings, Learning { actor, critic }: Learning<'_>) -> Self {
        let nothing = vec![0.0; actor.parameters().len() + critic.parameters().len()];
        Self { settings: *settings, anchor: nothing.clone(), gradient: nothing.clone(), last: nothing, tasks: 0 }
    }
}

impl Regulariser for ReferenceSoar {
    fn stored_bytes(&self) -> usize {
        4 * (self.anchor.len() + self.gradient.len() + 1)
    }

    fn add_gradient(&mut self, Learning { actor, critic }: Learning<'_>, gradient: &mut Gradient) {
        if self.tasks == 0 {
            return;
        }
        let ReferenceSoarSettings { rule, gradient_weight, curvature } = self.settings;
        let parameters = actor.parameters().iter().chain(critic.parameters());
        let remembered = self.anchor.iter().zip(&self.gradient);
        let sums = gradient.actor.iter_mut().chain(&mut gradient.critic);
        for ((sum, now), (anchor, old)) in sums.zip(parameters).zip(remembered) {
            let distance = now - anchor;
            *sum += match rule {
                SoarRule::Literal => gradient_weight * old - curvature * distance,
                SoarRule::Absolute => gradient_weight * old + curvature * distance.abs(),
                SoarRule::Head => -(gradient_weight * old + curvature * distance),
            };
        }
    }

    fn after_step(&mut self, _actor: &mut Actor, step: &OptimiserStep<'_>) {
        for (last, value) in self.last.iter_mut().zip(step.gradient.actor.iter().chain(&step.gradient.critic)) {
            *last = value * step.scale;
        }
    }

    fn consolidate(&mut self, ended: &EndedTask<'_>) {
        self.tasks += 1;
        let count = self.tasks as f32;
        let parameters = ended.actor.parameters().iter().chain(ended.critic.parameters());
        match self.settings.rule {
            SoarRule::Literal => {
                for (mean, now) in self.anchor.iter_mut().zip(parameters) {
                    *mean += (now - *mean) / count;
                }
                for (mean, last) in self.gradient.iter_mut().zip(&self.last) {
                    *mean += (last - *mean) / count;
                }
            }
            SoarRule::Absolute | SoarRule::Head if self.tasks == 1 => {
                self.anchor = parameters.copied().collect();
                self.gradient.clone_from(&self.last);
            }
            // The code adds the new policy before it averages, and averages the gradient into a variable that it drops.
            SoarRule::Absolute | SoarRule::Head => {
                for (sum, now) in self.anchor.iter_mut().zip(parameters) {
                    *sum = ((*sum + now) * (count - 1.0) + now) / count;
                }
            }
        }
    }
}
