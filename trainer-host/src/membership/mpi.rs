//! Ranks that MPI has started (`mpirun -n 4 kestrel train …`).

use kestrel_learn::ranks::Ranks;
use mpi::Threading;
use mpi::datatype::PartitionMut;
use mpi::environment::Universe;
use mpi::topology::{Communicator, SimpleCommunicator};
use mpi::traits::CommunicatorCollectives;

/// The MPI job; all of its processes leave it together when this is dropped.
pub(crate) struct Job {
    _universe: Universe,
}

/// All processes of the MPI job.
#[derive(Clone, Copy, Debug)]
pub(crate) struct World {
    rank: usize,
    size: usize,
}

impl Job {
    /// Joins it; `None` when the process is in one already.
    pub(crate) fn join() -> Option<Self> {
        // Workers of a study call from threads of their own, one at a time.
        let (universe, _) = mpi::initialize_with_threading(Threading::Serialized)?;
        Some(Self { _universe: universe })
    }
}

impl std::fmt::Debug for Job {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Job")
    }
}

impl World {
    /// Those of the job that was joined.
    pub(crate) fn of_job() -> Self {
        let world = SimpleCommunicator::world();
        Self { rank: world.rank() as usize, size: world.size() as usize }
    }
}

impl Ranks for World {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn share(&self, all: &mut [f32]) {
        let each = all.len() / self.size;
        let mine = all[self.rank * each..(self.rank + 1) * each].to_vec();
        SimpleCommunicator::world().all_gather_into(&mine[..], all);
    }

    fn gather(&self, mine: &[u8]) -> Vec<Vec<u8>> {
        let world = SimpleCommunicator::world();
        let mut counts = vec![0_i32; self.size];
        world.all_gather_into(&(mine.len() as i32), &mut counts[..]);
        let displacements: Vec<i32> = counts
            .iter()
            .scan(0, |end, count| {
                let start = *end;
                *end += count;
                Some(start)
            })
            .collect();
        let mut all = vec![0_u8; counts.iter().map(|count| *count as usize).sum()];
        {
            let mut partition = PartitionMut::new(&mut all[..], &counts[..], &displacements[..]);
            world.all_gather_varcount_into(mine, &mut partition);
        }
        let part = |(start, count): (&i32, &i32)| all[*start as usize..(*start + *count) as usize].to_vec();
        displacements.iter().zip(&counts).map(part).collect()
    }
}
