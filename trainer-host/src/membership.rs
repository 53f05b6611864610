//! This process among those that MPI has started (`mpirun -n 4 kestrel train …`).

#[cfg(feature = "mpi")]
mod mpi;

use std::sync::Arc;

use kestrel_learn::ranks::{self, Ranks};

/// This process's place among those that work together.
#[derive(Debug)]
pub(crate) struct Membership {
    /// All of them.
    pub(crate) ranks: Arc<dyn Ranks>,
    #[cfg(feature = "mpi")]
    _job: Option<mpi::Job>,
}

/// The process was started by MPI, which this program cannot talk to.
#[cfg(not(feature = "mpi"))]
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error(
    "mpirun started several processes, but this kestrel was built without MPI, and each would do all the work: build it \
     with `cargo build --release --features mpi`"
)]
struct WithoutMpi;

/// The ranks of the MPI job that this process belongs to, or the process alone.
///
/// # Errors
/// When there is such a job and the program was built without the feature `mpi`.
pub(crate) fn join() -> anyhow::Result<Membership> {
    // Open MPI, and those that keep to the process management interface (MPICH, Slurm).
    let told = |name| std::env::var(name).ok()?.parse::<usize>().ok();
    let started = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"].into_iter().find_map(told);
    if started.is_none_or(|size| size < 2) {
        return Ok(Membership {
            ranks: ranks::alone(),
            #[cfg(feature = "mpi")]
            _job: None,
        });
    }
    #[cfg(feature = "mpi")]
    {
        let job = mpi::Job::join();
        Ok(Membership { ranks: Arc::new(mpi::World::of_job()), _job: job })
    }
    #[cfg(not(feature = "mpi"))]
    Err(WithoutMpi.into())
}
