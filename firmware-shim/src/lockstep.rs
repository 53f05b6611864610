//! The loop that flies a vehicle in a plant: receive, tick, step, wait, over and over.

use std::str::FromStr;
use std::thread;
use std::time::{Duration, Instant};

use kestrel_core::vehicle::State;

use crate::autopilot::Mode;
use crate::link::{DATAGRAM_LIMIT, LinkError, UdpLink};
use crate::plant::Plant;
use crate::processor::Processor;
use crate::vehicle::MavlinkVehicle;

/// Datagrams that are read in one control period; a flood waits in the socket, and then is lost.
const DATAGRAMS_PER_TICK: usize = 64;

/// A loop that lags farther behind the wall clock does not catch up \[s\]: the machine slept or is too slow.
const LAG_LIMIT: Duration = Duration::from_millis(250);

/// How simulated time relates to the wall clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// So many simulated seconds in a second, above zero; 1 is real time.
    Speed(f64),
    /// As fast as it goes.
    Unthrottled,
}

/// What is no [`Pace`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a factor of real time from 0.01 to 1000, or \"max\", found \"{0}\"")]
pub struct PaceError(String);

impl FromStr for Pace {
    type Err = PaceError;

    fn from_str(text: &str) -> Result<Self, PaceError> {
        if text == "max" {
            return Ok(Self::Unthrottled);
        }
        match text.parse() {
            Ok(speed) if (0.01..=1000.0).contains(&speed) => Ok(Self::Speed(speed)),
            Ok(_) | Err(_) => Err(PaceError(text.to_owned())),
        }
    }
}

/// One control period of a flight, after the vehicle decided and before the plant moves.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// Simulated time since the start \[s\].
    pub secs: f64,
    /// True state.
    pub state: &'a State<f32>,
    /// What the autopilot is doing.
    pub mode: Mode,
    /// What the rotors are told \[rad/s\].
    pub rotor_targets: [f32; 4],
}

/// Whether a flight goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// It does.
    Fly,
    /// It ends here.
    End,
}

/// Flies until `watch`, which sees every control period, ends it.
///
/// # Errors
/// [`LinkError::Receive`] if the socket fails.
pub fn fly<P: Processor>(
    vehicle: &mut MavlinkVehicle<P>,
    plant: &mut dyn Plant,
    link: &mut UdpLink,
    pace: Pace,
    watch: &mut dyn FnMut(&Moment) -> Next,
) -> Result<(), LinkError> {
    let mut clock = Clock::new(pace, vehicle.control_period());
    loop {
        receive(vehicle, link)?;
        let secs = vehicle.elapsed_secs();
        let rotor_targets = vehicle.tick(plant.state(), &mut |frame| link.send(frame));
        let moment = Moment { secs, state: plant.state(), mode: vehicle.mode(), rotor_targets };
        if watch(&moment) == Next::End {
            return Ok(());
        }
        plant.step(&rotor_targets);
        clock.wait();
    }
}

fn receive<P: Processor>(vehicle: &mut MavlinkVehicle<P>, link: &mut UdpLink) -> Result<(), LinkError> {
    let mut buffer = [0; DATAGRAM_LIMIT];
    for _ in 0..DATAGRAMS_PER_TICK {
        let Some((datagram, sender)) = link.receive(&mut buffer)? else { break };
        if vehicle.receive(datagram) {
            link.learn(sender);
        }
    }
    Ok(())
}

/// Keeps the loop from running ahead of the wall clock.
#[derive(Debug)]
pub(crate) struct Clock {
    /// Wall time of a control period; none if unthrottled.
    period: Option<Duration>,
    due: Instant,
}

impl Clock {
    pub(crate) fn new(pace: Pace, control_period: Duration) -> Self {
        let period = match pace {
            Pace::Speed(speed) => Some(control_period.div_f64(speed)),
            Pace::Unthrottled => None,
        };
        Self { period, due: Instant::now() }
    }

    pub(crate) fn wait(&mut self) {
        let Some(period) = self.period else { return };
        self.due += period;
        let now = Instant::now();
        if now > self.due + LAG_LIMIT {
            self.due = now;
        }
        thread::sleep(self.due.saturating_duration_since(now));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pace_is_a_factor_or_max() {
        assert_eq!("1".parse(), Ok(Pace::Speed(1.0)));
        assert_eq!("0.5".parse(), Ok(Pace::Speed(0.5)));
        assert_eq!("max".parse(), Ok(Pace::Unthrottled));
        for wrong in ["0", "-1", "nan", "inf", "fast", "", "1e9"] {
            let error = wrong.parse::<Pace>().unwrap_err();
            assert!(error.to_string().contains(&format!("found \"{wrong}\"")));
        }
    }

    #[test]
    fn the_clock_keeps_its_speed_on_average() {
        let mut clock = Clock::new(Pace::Speed(2.0), Duration::from_millis(10));
        let start = Instant::now();
        for _ in 0..20 {
            clock.wait();
        }
        assert!(start.elapsed() >= Duration::from_millis(99));
    }

    #[test]
    fn lost_time_is_not_caught_up() {
        let mut clock = Clock::new(Pace::Speed(1.0), Duration::from_millis(10));
        thread::sleep(LAG_LIMIT + Duration::from_millis(100));
        clock.wait();
        let start = Instant::now();
        clock.wait();
        assert!(start.elapsed() >= Duration::from_millis(9));
    }
}
