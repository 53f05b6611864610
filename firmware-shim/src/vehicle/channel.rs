//! What a vehicle keeps of each of its peers: the number of its next frame to it, and which messages it wants how often.

use crate::link::Peer;
use crate::telemetry::{TelemetrySchedule, TelemetryStream};

/// Requested messages that wait for the next tick, of one peer.
const REQUESTED: usize = TelemetryStream::ALL.len();

/// One peer's.
#[derive(Clone, Debug)]
pub(super) struct Channel {
    pub(super) peer: Peer,
    /// Number of the next frame to it.
    pub(super) sequence: u8,
    /// The same of the camera's.
    pub(super) camera_sequence: u8,
    schedule: TelemetrySchedule,
    /// Streams that it wants once more, out of turn.
    requested: heapless::Vec<TelemetryStream, REQUESTED>,
}

/// Everybody's.
#[derive(Clone, Debug)]
pub(super) struct Channels {
    default: TelemetrySchedule,
    open: Vec<Channel>,
}

impl Channels {
    /// Of nobody yet, with ticks of `control_secs`.
    pub(super) fn new(control_secs: f32) -> Self {
        Self { default: TelemetrySchedule::new(control_secs), open: Vec::new() }
    }

    /// The channel of a peer, new or known.
    pub(super) fn open(&mut self, peer: Peer) -> &mut Channel {
        let known = self.open.iter().position(|channel| channel.peer == peer);
        let number = known.unwrap_or_else(|| {
            let schedule = self.default.clone();
            self.open.push(Channel {
                peer,
                sequence: 0,
                camera_sequence: 0,
                schedule,
                requested: heapless::Vec::new(),
            });
            self.open.len() - 1
        });
        &mut self.open[number]
    }

    /// Has these peers listen, in this order, and forgets all others.
    pub(super) fn are_of(&mut self, listeners: &[Peer]) {
        if !self.open.iter().map(|channel| &channel.peer).eq(listeners) {
            self.open = listeners.iter().map(|peer| self.open(*peer).clone()).collect();
        }
    }

    /// Everybody who listens.
    pub(super) fn listening(&mut self) -> impl Iterator<Item = &mut Channel> {
        self.open.iter_mut()
    }

    /// Whether a stream is due to anybody at a tick.
    pub(super) fn are_due(&self, stream: TelemetryStream, tick: u64) -> bool {
        self.open.iter().any(|channel| channel.is_due(stream, tick))
    }

    /// To whom a stream is due.
    pub(super) fn due(&mut self, stream: TelemetryStream, tick: u64) -> impl Iterator<Item = &mut Channel> {
        self.open.iter_mut().filter(move |channel| channel.is_due(stream, tick))
    }

    /// What was requested out of turn has been sent.
    pub(super) fn end_period(&mut self) {
        self.open.iter_mut().for_each(|channel| channel.requested.clear());
    }
}

impl Channel {
    /// Has a stream sent every `secs`, as [`TelemetrySchedule::set_interval`].
    pub(super) fn set_interval(&mut self, stream: TelemetryStream, secs: f32) {
        self.schedule.set_interval(stream, secs);
    }

    /// Has a stream sent once with the next tick.
    pub(super) fn request(&mut self, stream: TelemetryStream) {
        if !self.requested.contains(&stream) {
            // There is room for each of them once.
            let _ = self.requested.push(stream);
        }
    }

    /// Time between two messages of a stream \[s\]; none if it is never sent.
    pub(super) fn interval_secs(&self, stream: TelemetryStream) -> Option<f32> {
        self.schedule.interval_secs(stream)
    }

    fn is_due(&self, stream: TelemetryStream, tick: u64) -> bool {
        self.schedule.due(stream, tick) || self.requested.contains(&stream)
    }
}
