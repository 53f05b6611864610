//! Nodes to go on from, the ones with the least estimates first.

/// Estimates that differ by less than this are equal: a fifth of a spacing in the open.
const WIDTH: u32 = 32;

/// So many lists, as [`WIDTH`] times that is more than a step adds to an estimate.
const BUCKETS: usize = 512;

/// Numbers from here on are those of lists instead of nodes.
pub(super) const NODE_LIMIT: usize = (1 << 16) - BUCKETS;

/// A node for each number below `NODES`, in a list of those with about the same estimate, or in none. Lists are linked both
/// ways, and are used again, one after the other.
#[derive(Clone, Debug)]
pub(super) struct Queue<const NODES: usize> {
    nodes: [Link; NODES],
    lists: [Link; BUCKETS],
    /// Number of the list of the least estimate, before it is used again.
    least: u32,
    len: usize,
}

#[derive(Clone, Copy, Debug)]
struct Link {
    before: u16,
    behind: u16,
}

impl<const NODES: usize> Queue<NODES> {
    /// An empty one.
    pub(super) const fn new() -> Self {
        let none = Link { before: 0, behind: 0 };
        let mut queue = Self { nodes: [none; NODES], lists: [none; BUCKETS], least: 0, len: 0 };
        let mut list = 0;
        while list < BUCKETS {
            queue.lists[list] = alone(list);
            list += 1;
        }
        queue
    }

    /// Empties it; the least estimate will be this.
    pub(super) fn clear(&mut self, estimate: u32) {
        (self.least, self.len) = (estimate / WIDTH, 0);
        for (list, link) in self.lists.iter_mut().enumerate() {
            *link = alone(list);
        }
    }

    /// Puts in a node that is not in. Where its estimate is below the least, it is as the least.
    #[inline(always)]
    pub(super) fn push(&mut self, node: u16, estimate: u32) {
        let number = (estimate / WIDTH).max(self.least) as usize % BUCKETS;
        let list = (NODE_LIMIT + number) as u16;
        let first = core::mem::replace(&mut self.lists[number].behind, node);
        self.nodes[usize::from(node)] = Link { before: list, behind: first };
        self.link(first).before = node;
        self.len += 1;
    }

    /// Takes out a node that was put in since it was cleared, if it is still in.
    #[inline(always)]
    pub(super) fn remove(&mut self, node: u16) {
        let link = &mut self.nodes[usize::from(node)];
        let Link { before, behind } = core::mem::replace(link, Link { before: node, behind: node });
        if before == node {
            return;
        }
        self.link(before).behind = behind;
        self.link(behind).before = before;
        self.len -= 1;
    }

    /// Takes out one of the nodes with the least estimate, the one that came last.
    #[inline(always)]
    pub(super) fn pop(&mut self) -> Option<u16> {
        if self.len == 0 {
            return None;
        }
        loop {
            let first = self.lists[self.least as usize % BUCKETS].behind;
            if usize::from(first) < NODE_LIMIT {
                self.remove(first);
                return Some(first);
            }
            self.least += 1;
        }
    }

    #[inline(always)]
    fn link(&mut self, number: u16) -> &mut Link {
        let number = usize::from(number);
        if number < NODE_LIMIT { &mut self.nodes[number] } else { &mut self.lists[number - NODE_LIMIT] }
    }
}

/// The link of a list without nodes, to itself.
const fn alone(list: usize) -> Link {
    let own = (NODE_LIMIT + list) as u16;
    Link { before: own, behind: own }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_come_out_by_their_estimates_wherever_they_were_moved() {
        let mut queue = Queue::<100>::new();
        queue.clear(1000);
        let estimate = |node: u16| 1000 + 37 * WIDTH * (u32::from(node) * 7 % 100) / 10;
        for node in 0..100 {
            queue.push(node, estimate(node));
        }
        // One is nearer than it was thought to be, one is not in it any more.
        queue.remove(50);
        queue.push(50, 0);
        queue.remove(60);
        queue.remove(60);
        let order: std::vec::Vec<u16> = core::iter::from_fn(|| queue.pop()).collect();
        assert_eq!((order.len(), order[0]), (99, 50));
        let rounded = |node: &u16| estimate(*node) / WIDTH;
        assert!(order[1..].is_sorted_by_key(rounded), "{order:?}");
        assert!(!order.contains(&60));
        queue.clear(0);
        assert_eq!(queue.pop(), None);
    }

    #[test]
    fn lists_are_used_again() {
        let mut queue = Queue::<3>::new();
        queue.clear(0);
        let mut estimate = 0;
        queue.push(0, 0);
        for turn in 0..2000_u32 {
            let node = queue.pop().unwrap();
            assert_eq!(u32::from(node), turn % 3);
            estimate += WIDTH * (BUCKETS as u32 - 1);
            queue.push(((turn + 1) % 3) as u16, estimate);
        }
    }
}
