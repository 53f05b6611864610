//! Ranks that are threads of one process: what tests work with.

use std::sync::{Arc, Barrier, Mutex, MutexGuard};

use super::Ranks;

/// What threads lay open for each other.
#[derive(Debug)]
struct Table {
    said: Mutex<Vec<Vec<u8>>>,
    barrier: Barrier,
}

impl Table {
    fn said(&self) -> MutexGuard<'_, Vec<Vec<u8>>> {
        self.said.lock().expect("no rank panics while it says something")
    }
}

/// One of several threads.
#[derive(Clone, Debug)]
struct Thread {
    rank: usize,
    table: Arc<Table>,
}

/// Runs `work` as every one of so many ranks at once; returns what each comes to.
///
/// # Panics
/// When `work` does.
pub fn run_as<T: Send>(size: usize, work: impl Fn(Arc<dyn Ranks>) -> T + Sync) -> Vec<T> {
    let table = Arc::new(Table { said: Mutex::new(vec![Vec::new(); size]), barrier: Barrier::new(size) });
    std::thread::scope(|scope| {
        let spawned: Vec<_> = (0..size)
            .map(|rank| {
                let (table, work) = (Arc::clone(&table), &work);
                scope.spawn(move || work(Arc::new(Thread { rank, table })))
            })
            .collect();
        spawned.into_iter().map(|thread| thread.join().expect("a rank does its work")).collect()
    })
}

impl Ranks for Thread {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.table.said().len()
    }

    fn share(&self, all: &mut [f32]) {
        let each = all.len() / self.size();
        let mine: Vec<u8> =
            all[self.rank * each..(self.rank + 1) * each].iter().flat_map(|value| value.to_le_bytes()).collect();
        let bytes = self.gather(&mine).concat();
        for (value, bytes) in all.iter_mut().zip(bytes.chunks_exact(4)) {
            *value = f32::from_le_bytes(bytes.try_into().expect("four bytes a value"));
        }
    }

    fn gather(&self, mine: &[u8]) -> Vec<Vec<u8>> {
        self.table.said()[self.rank] = mine.to_vec();
        self.table.barrier.wait();
        let said = self.table.said().clone();
        self.table.barrier.wait();
        said
    }
}
