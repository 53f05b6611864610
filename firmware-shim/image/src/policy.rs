//! The policies in the image.

use kestrel_core::policy_file::Aligned;

/// A policy file in memory, on the boundary that [`PolicyFile`](kestrel_core::policy_file::PolicyFile) wants.
#[derive(Clone, Copy, Debug)]
pub struct Artifact {
    /// As in `assets/pilots`.
    pub name: &'static str,
    /// The file.
    pub bytes: &'static [u8],
}

include!(concat!(env!("OUT_DIR"), "/policies.rs"));
