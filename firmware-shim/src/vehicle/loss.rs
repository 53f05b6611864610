//! Which senders' frames get lost on their way: those whose numbers are missing.

use kestrel_onboard::repetition::Sender;

/// Senders that are watched.
const SENDERS: usize = 8;

/// A link that lost a frame counts as one that loses for so long \[s\]: a ground station speaks once a second at least, so at
/// a loss of a tenth one of its numbers is missing within this time, most of the time.
const MEMORY_SECS: f64 = 20.0;

/// Numbers further ahead than this are behind: a frame was overtaken.
const AHEAD: u8 = 127;

/// The last number of each sender.
#[derive(Debug, Default)]
pub(super) struct Losses {
    known: heapless::Deque<Known, SENDERS>,
}

#[derive(Clone, Copy, Debug)]
struct Known {
    sender: Sender,
    /// When a number was missing last \[s\].
    missed_secs: Option<f64>,
}

impl Losses {
    /// Takes note of a frame.
    pub(super) fn note(&mut self, sender: Sender, now_secs: f64) {
        let Some(known) = self.known.iter_mut().find(|known| known.sender.address == sender.address) else {
            if self.known.is_full() {
                self.known.pop_front();
            }
            // There is room: the oldest has just left.
            let _ = self.known.push_back(Known { sender, missed_secs: None });
            return;
        };
        match sender.sequence.wrapping_sub(known.sender.sequence) {
            0 => {}
            1 => known.sender = sender,
            2..=AHEAD => *known = Known { sender, missed_secs: Some(now_secs) },
            _ => {}
        }
    }

    /// Whether frames of this sender were lost of late; then what is sent to it is, too.
    pub(super) fn are_of(&self, sender: Sender, now_secs: f64) -> bool {
        let known = self.known.iter().find(|known| known.sender.address == sender.address);
        let missed_secs = known.and_then(|known| known.missed_secs);
        missed_secs.is_some_and(|missed_secs| now_secs - missed_secs <= MEMORY_SECS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sender(sequence: u8) -> Sender {
        Sender { address: [255, 190], sequence }
    }

    /// Whether losses were seen after these numbers, a second apart.
    fn seen(sequences: &[u8]) -> bool {
        let mut losses = Losses::default();
        for (secs, sequence) in (0..).zip(sequences) {
            losses.note(sender(*sequence), f64::from(secs));
        }
        losses.are_of(sender(0), sequences.len() as f64)
    }

    #[test]
    fn missing_numbers_are_losses_and_doubled_ones_are_not() {
        assert!(!seen(&[]));
        assert!(!seen(&[7, 8, 9, 9, 10]));
        assert!(!seen(&[254, 255, 0, 1]));
        assert!(!seen(&[10, 9, 8, 11]), "overtaken ones");
        assert!(seen(&[7, 9]));
        assert!(seen(&[255, 1]));
    }

    #[test]
    fn losses_are_forgotten_and_are_those_of_one_sender() {
        let mut losses = Losses::default();
        losses.note(sender(1), 0.0);
        losses.note(sender(3), 1.0);
        assert!(losses.are_of(sender(4), 1.0 + MEMORY_SECS));
        assert!(!losses.are_of(sender(4), 1.1 + MEMORY_SECS));
        assert!(!losses.are_of(Sender { address: [254, 190], sequence: 4 }, 2.0));
        for system in 0..SENDERS as u8 {
            losses.note(Sender { address: [system, 1], sequence: 0 }, 2.0);
        }
        assert!(!losses.are_of(sender(4), 2.0), "the oldest is forgotten first");
    }
}
