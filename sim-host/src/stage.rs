//! What a step of a block needs beside the block.

use kestrel_core::action::Controls;
use kestrel_core::real::Real;

use crate::contact::ContactSolver;
use crate::rooms::Arenas;
use crate::scenario::Scenario;
use crate::swarm::Mechanics;

/// What a step needs beside the block.
pub(crate) struct Stage<'a, R: Real> {
    pub(crate) scenario: &'a Scenario,
    pub(crate) controls: &'a Controls<R>,
    pub(crate) mechanics: &'a Mechanics<R>,
    pub(crate) arenas: Option<&'a Arenas>,
    pub(crate) solver: Option<&'a ContactSolver>,
    pub(crate) control_secs: R,
}
