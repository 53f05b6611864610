//! The places where slices are differentiated.

use std::sync::{Mutex, MutexGuard};

use crate::actor_critic::{ActorCriticWorkspace, Gradient, Networks};
use crate::environment::Outcome;
use crate::network::InputBatch;
use crate::rollout::MinibatchSlice;

/// One workspace for each thread: what is worked on stays in the cache of one core.
#[derive(Debug, Default)]
pub(crate) struct Workspaces {
    workspaces: Vec<Mutex<SliceWorkspace>>,
}

impl Workspaces {
    /// Sees to it that each thread of the current rayon pool has one, for slices of so many samples.
    pub(crate) fn provide(&mut self, networks: &Networks<'_>, columns: usize) {
        let workspace = || Mutex::new(SliceWorkspace::new(networks, columns));
        self.workspaces.resize_with(rayon::current_num_threads(), workspace);
    }

    /// The calling thread's.
    ///
    /// # Panics
    /// Outside of the pool for which they were provided.
    pub(crate) fn mine(&self) -> MutexGuard<'_, SliceWorkspace> {
        let thread = rayon::current_thread_index().expect("workspaces are for the threads of a pool");
        self.workspaces[thread].lock().expect("no workspace outlives a panic of its thread")
    }
}

impl Clone for Workspaces {
    /// Nothing on a workspace outlasts a slice: the clone is provided anew.
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// The place where one thread differentiates slice after slice.
#[derive(Debug)]
pub(crate) struct SliceWorkspace {
    /// A slice's, copied in one go: the products read them in strides of a kilobyte, which no processor fetches ahead.
    values: Vec<f32>,
    networks: ActorCriticWorkspace,
}

impl SliceWorkspace {
    pub(crate) fn new(networks: &Networks<'_>, columns: usize) -> Self {
        Self { values: Vec::new(), networks: ActorCriticWorkspace::new(networks.actor, networks.critic, columns) }
    }

    /// Evaluates both networks on a slice: the first of a window, or one that follows the slice of these `outcomes
    /// [columns]`.
    pub(crate) fn forward(
        &mut self,
        networks: &Networks<'_>,
        batch: InputBatch<'_>,
        outcomes: Option<&[Outcome]>,
    ) {
        let Self { values, networks: workspace } = self;
        values.clear();
        values.extend_from_slice(batch.values);
        let batch = InputBatch { values, ..batch };
        match outcomes {
            None => workspace.encode(networks, batch),
            Some(outcomes) => workspace.encode_next(networks, batch, outcomes),
        }
        workspace.mean_actions(networks, batch);
        workspace.predict_value(networks, batch);
    }

    /// Mean actions `[action length][columns]` and, to be written, the loss gradient of each value.
    pub(crate) fn action_deltas(&mut self) -> (&[f32], &mut [f32]) {
        self.networks.action_deltas()
    }

    /// Outputs of the critic's heads `[tasks][columns]` and, to be written, the loss gradient of each value.
    pub(crate) fn head_deltas(&mut self) -> (&[f32], &mut [f32]) {
        self.networks.head_deltas()
    }

    /// Adds the gradient of both networks for the slice that [`Self::forward`] evaluated last, whose images these are.
    pub(crate) fn backward(&mut self, networks: &Networks<'_>, images: &[u8], gradient: &mut Gradient) {
        let batch = InputBatch { values: &self.values, images, hidden: &[] };
        self.networks.backward(networks, batch, (&mut gradient.actor, &mut gradient.critic));
    }

    /// Adds the gradient of the memory, if there is one, and of the encoder in front of it, for the window of these slices,
    /// which all went through [`Self::backward`].
    pub(crate) fn backward_window(
        &mut self,
        networks: &Networks<'_>,
        window: &[MinibatchSlice<'_>],
        gradient: &mut Gradient,
    ) {
        let (seen, outcomes) = (|step: usize| window[step].batch, |step: usize| window[step].outcomes);
        self.networks.backward_window(networks, seen, outcomes, &mut gradient.actor);
    }
}
