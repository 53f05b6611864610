//! Nodes to go on from, the ones with the least estimates first.

/// Estimates that differ by less than this are equal: a fifth of a spacing in the open.
const WIDTH: u32 = 32;

/// So many lists.
const BUCKETS: usize = 512;

/// Estimates in the queue are apart by less than this.
pub(super) const RANGE: u32 = WIDTH * (BUCKETS as u32 - 1);

/// Numbers from here on are those of lists instead of nodes.
pub(super) const NODE_LIMIT: usize = (1 << 16) - BUCKETS;

/// What a search remembers of a node.
#[derive(Clone, Copy, Debug, Default)]
pub struct SearchNode {
    /// Of the shortest path to the goal that was found.
    pub(super) length: u32,
    link: Link,
}

/// The neighbours in a list.
#[derive(Clone, Copy, Debug, Default)]
struct Link {
    before: u16,
    behind: u16,
}

/// Nodes in lists of those with about the same estimate, or in none. Lists are linked both ways, and are used again, one after
/// the other.
pub(super) struct Queue<'m> {
    pub(super) nodes: &'m mut [SearchNode],
    lists: [Link; BUCKETS],
    /// Number of the list of the least estimate, before it is used again.
    least: u32,
    len: usize,
}

impl<'m> Queue<'m> {
    /// An empty one, of nodes that all have this length; no estimate will be less than this one.
    pub(super) fn new(nodes: &'m mut [SearchNode], length: u32, estimate: u32) -> Self {
        nodes.fill(SearchNode { length, link: Link::default() });
        Self { nodes, lists: core::array::from_fn(alone), least: estimate / WIDTH, len: 0 }
    }

    /// Puts in a node that is not in. Where its estimate is below the least, it is as the least.
    #[inline(always)]
    pub(super) fn push(&mut self, node: u16, estimate: u32) {
        let number = (estimate / WIDTH).max(self.least) as usize % BUCKETS;
        let list = (NODE_LIMIT + number) as u16;
        let first = core::mem::replace(&mut self.lists[number].behind, node);
        self.nodes[usize::from(node)].link = Link { before: list, behind: first };
        self.link(first).before = node;
        self.len += 1;
    }

    /// Takes out a node that was put in, if it is still in.
    #[inline(always)]
    pub(super) fn remove(&mut self, node: u16) {
        let link = &mut self.nodes[usize::from(node)].link;
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
        if number < NODE_LIMIT { &mut self.nodes[number].link } else { &mut self.lists[number - NODE_LIMIT] }
    }
}

/// The link of a list without nodes, to itself.
fn alone(list: usize) -> Link {
    let own = (NODE_LIMIT + list) as u16;
    Link { before: own, behind: own }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_come_out_by_their_estimates_wherever_they_were_moved() {
        let mut nodes = [SearchNode::default(); 100];
        let mut queue = Queue::new(&mut nodes, 0, 1000);
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
        assert_eq!(queue.pop(), None);
        assert_eq!(Queue::new(&mut nodes, 7, 0).pop(), None);
        assert!(nodes.iter().all(|node| node.length == 7));
    }

    #[test]
    fn lists_are_used_again() {
        let mut nodes = [SearchNode::default(); 3];
        let mut queue = Queue::new(&mut nodes, 0, 0);
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
