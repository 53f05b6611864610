//! The loop around [`ArdupilotSimulator`]: a frame of servos in, a step, a line out.

use std::net::SocketAddr;
use std::time::Duration;

use super::{ArdupilotSimulator, ServoRequest};
use crate::bridge::BridgeError;
use crate::bridge::datagram::DatagramSocket;
use crate::bridge::drone::Drone;
use crate::bridge::event::{BridgeCounts, BridgeEvent};
use crate::lockstep::{Clock, Next, SimulationRate};

/// One look for a datagram waits no longer than this.
const LOOK_LIMIT: Duration = Duration::from_millis(100);

/// Silence after which ArduPilot has gone: it repeats a frame that is not answered every second.
const SILENT_LOOKS: u32 = 30;

/// Serves one ArduPilot after the other, in steps of `period`, until `watch` ends it.
///
/// # Errors
/// [`BridgeError::Socket`] if the socket fails.
pub fn serve(
    drone: &mut Drone<'_>,
    socket: &mut DatagramSocket,
    period: Duration,
    pace: SimulationRate,
    watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
) -> Result<BridgeCounts, BridgeError> {
    let mut server =
        Server { drone, simulator: ArdupilotSimulator::new(), period, counts: BridgeCounts::default(), looks: 0 };
    let mut clock = Clock::new(pace, period);
    loop {
        let Some((datagram, sender)) = socket.receive(LOOK_LIMIT)? else {
            if server.miss(watch) == Next::End {
                break;
            }
            continue;
        };
        let Some(request) = server.simulator.receive(datagram) else { continue };
        let next = match request {
            ServoRequest::Step(throttles) => server.step(&throttles, sender, watch),
            ServoRequest::Repeat => Next::Fly,
        };
        socket.send(server.simulator.last_answer().as_bytes(), sender);
        if next == Next::End {
            break;
        }
        if request != ServoRequest::Repeat {
            clock.wait();
        }
    }
    server.counts.garbage = server.simulator.garbage();
    Ok(server.counts)
}

struct Server<'a, 'p> {
    drone: &'a mut Drone<'p>,
    simulator: ArdupilotSimulator,
    period: Duration,
    counts: BridgeCounts,
    /// Looks for a datagram since the last one.
    looks: u32,
}

impl Server<'_, '_> {
    /// Nothing has arrived.
    fn miss(&mut self, watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next) -> Next {
        self.looks = self.looks.saturating_add(1);
        let flying = self.counts.steps > 0;
        if flying && self.looks == SILENT_LOOKS { watch(&BridgeEvent::Gone) } else { watch(&BridgeEvent::Waiting) }
    }

    fn step(
        &mut self,
        throttles: &[f32; 4],
        sender: SocketAddr,
        watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
    ) -> Next {
        self.looks = 0;
        if self.simulator.restarts() > self.counts.connections {
            self.counts.connections = self.simulator.restarts();
            self.drone.restart_instruments();
            if watch(&BridgeEvent::Connected(sender)) == Next::End || watch(&BridgeEvent::Engaged) == Next::End {
                return Next::End;
            }
        }
        self.drone.step(throttles);
        self.counts.steps += 1;
        self.counts.answered += 1;
        self.simulator.answer(self.drone.measurement(), self.drone.state(), self.period.as_secs_f64());
        watch(&self.drone.stepped(self.counts.steps as f64 * self.period.as_secs_f64()))
    }
}
