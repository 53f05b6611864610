//! Synaptic intelligence (Zenke et al. 2017): a parameter matters as much as moving it has lowered the loss.

use kestrel_config::{ConfigError, Field};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{EndedTask, Learning, OptimiserStep, Regulariser, STRENGTH, check_number};
use crate::actor_critic::{Actor, Gradient};

/// Added to squared distances, so that a parameter that has not moved has no importance (ibid., eq. 5).
const SMALLEST_MOVE: f32 = 1e-3;

/// How strongly the policy is regularised towards earlier ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SynapticIntelligenceSettings {
    /// Factor on the penalty, with importances divided by their mean.
    pub strength: f32,
}

impl SynapticIntelligenceSettings {
    pub(super) fn check(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        check_number(field, "strength", self.strength, &STRENGTH)
    }
}

/// Importances along the path of training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SynapticIntelligence {
    settings: SynapticIntelligenceSettings,
    center: Vec<f32>,
    importance: Vec<f32>,
    /// Loss that moving each parameter has saved in the present task.
    saved: Vec<f32>,
    /// The present task's first policy.
    first: Vec<f32>,
    /// Gradient of the present minibatch without the penalty, and the policy before the step.
    step: Vec<(f32, f32)>,
    tasks: u32,
}

impl SynapticIntelligence {
    pub(super) fn new(settings: &SynapticIntelligenceSettings, Learning { actor, .. }: Learning<'_>) -> Self {
        let nothing = vec![0.0; actor.mlp().parameter_count()];
        Self {
            settings: *settings,
            center: nothing.clone(),
            importance: nothing.clone(),
            saved: nothing,
            first: Vec::new(),
            step: Vec::new(),
            tasks: 0,
        }
    }
}

impl Regulariser for SynapticIntelligence {
    fn stored_bytes(&self) -> usize {
        4 * (self.center.len() + self.importance.len() + 1)
    }

    fn training_bytes(&self) -> usize {
        // Saved loss, first policy, gradient and policy of the step.
        self.stored_bytes() + 4 * 4 * self.saved.len()
    }

    fn add_gradient(&mut self, Learning { actor, .. }: Learning<'_>, gradient: &mut Gradient) {
        let gradient = &mut gradient.actor;
        let parameters = &actor.parameters()[..self.center.len()];
        if self.first.is_empty() {
            self.first = parameters.to_vec();
        }
        self.step.clear();
        self.step.extend(gradient.iter().copied().zip(parameters.iter().copied()));
        if self.tasks > 0 {
            let penalties = self.importance.iter().zip(&self.center);
            for ((gradient, now), (importance, center)) in gradient.iter_mut().zip(parameters).zip(penalties) {
                *gradient += self.settings.strength * importance * (now - center);
            }
        }
    }

    fn after_step(&mut self, actor: &mut Actor, _step: &OptimiserStep<'_>) {
        for ((saved, (gradient, before)), now) in self.saved.iter_mut().zip(&self.step).zip(actor.parameters()) {
            *saved -= gradient * (now - before);
        }
    }

    fn consolidate(&mut self, ended: &EndedTask<'_>) {
        let parameters = &ended.actor.parameters()[..self.center.len()];
        let moves = parameters.iter().zip(&self.first).map(|(now, first)| now - first);
        let gains: Vec<f32> = self
            .saved
            .iter()
            .zip(moves)
            .map(|(saved, moved)| saved.max(0.0) / (moved * moved + SMALLEST_MOVE))
            .collect();
        let mean = (gains.iter().sum::<f32>() / gains.len() as f32).max(f32::MIN_POSITIVE);
        for (importance, gain) in self.importance.iter_mut().zip(gains) {
            *importance += gain / mean;
        }
        self.center.copy_from_slice(parameters);
        self.saved.fill(0.0);
        self.first.clear();
        self.tasks += 1;
    }
}
