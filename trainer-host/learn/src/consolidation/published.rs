//! IL-SOAR as the thesis wrote it and as its public code computed it: for the record, not for use.
//!
//! The thesis adds `+ L/2 ‖θ − θ_l‖²` to an objective that it maximises, which repels the policy from its anchors. Both
//! versions of the code are wrong in other ways, and their running means are none.

use serde::{Deserialize, Serialize};

use super::Ended;
use crate::actor_critic::{Actor, Critic};
use crate::ppo::Gradient;

/// How an earlier policy and its gradient enter the gradient of the loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PublishedRule {
    /// Equation 3.8, as a loss: `+ w g − L (θ − mean θ_l)`; means are means.
    Literal,
    /// The code of October 2022: `+ w g + L |θ − a|`, each parameter pushed down; sums for means.
    Absolute,
    /// The code's last version, November 2022: `− (w g + L (θ − a))`; sums for means.
    Head,
}

/// Which rule, how strong.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PublishedSettings {
    /// How they enter.
    pub rule: PublishedRule,
    /// `w`.
    pub gradient_weight: f32,
    /// `L`.
    pub curvature: f32,
}

/// What the published method remembers: one policy and one gradient, of actor, standard deviations and critic.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Published {
    settings: PublishedSettings,
    anchor: Vec<f32>,
    gradient: Vec<f32>,
    /// The gradient of the last minibatch, its pull included, after it was shortened.
    last: Vec<f32>,
    tasks: u32,
}

impl Published {
    pub(super) fn new(settings: &PublishedSettings, actor: &Actor, critic: &Critic) -> Self {
        let nothing = vec![0.0; actor.parameters().len() + critic.parameters().len()];
        Self { settings: *settings, anchor: nothing.clone(), gradient: nothing.clone(), last: nothing, tasks: 0 }
    }

    pub(super) fn stored_bytes(&self) -> usize {
        4 * (self.anchor.len() + self.gradient.len() + 1)
    }

    pub(super) fn add_gradient(&mut self, actor: &Actor, critic: &Critic, gradient: &mut Gradient) {
        if self.tasks == 0 {
            return;
        }
        let PublishedSettings { rule, gradient_weight, curvature } = self.settings;
        let parameters = actor.parameters().iter().chain(critic.parameters());
        let remembered = self.anchor.iter().zip(&self.gradient);
        let sums = gradient.actor.iter_mut().chain(&mut gradient.critic);
        for ((sum, now), (anchor, old)) in sums.zip(parameters).zip(remembered) {
            let distance = now - anchor;
            *sum += match rule {
                PublishedRule::Literal => gradient_weight * old - curvature * distance,
                PublishedRule::Absolute => gradient_weight * old + curvature * distance.abs(),
                PublishedRule::Head => -(gradient_weight * old + curvature * distance),
            };
        }
    }

    pub(super) fn after_step(&mut self, gradient: &Gradient, scale: f32) {
        for (last, value) in self.last.iter_mut().zip(gradient.actor.iter().chain(&gradient.critic)) {
            *last = value * scale;
        }
    }

    pub(super) fn consolidate(&mut self, ended: &Ended<'_>) {
        self.tasks += 1;
        let count = self.tasks as f32;
        let parameters = ended.actor.parameters().iter().chain(ended.critic.parameters());
        match self.settings.rule {
            PublishedRule::Literal => {
                for (mean, now) in self.anchor.iter_mut().zip(parameters) {
                    *mean += (now - *mean) / count;
                }
                for (mean, last) in self.gradient.iter_mut().zip(&self.last) {
                    *mean += (last - *mean) / count;
                }
            }
            PublishedRule::Absolute | PublishedRule::Head if self.tasks == 1 => {
                self.anchor = parameters.copied().collect();
                self.gradient.clone_from(&self.last);
            }
            // The code adds the new policy before it averages, and averages the gradient into a variable that it drops.
            PublishedRule::Absolute | PublishedRule::Head => {
                for (sum, now) in self.anchor.iter_mut().zip(parameters) {
                    *sum = ((*sum + now) * (count - 1.0) + now) / count;
                }
            }
        }
    }
}
