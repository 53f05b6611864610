//! The shape of a firmware with `embassy`: an async task that owns the pilot and ticks at the policy's own pace.
//!
//! On a microcontroller `#[embassy_executor::main]` stands before `main` and `Ticker` is `embassy_time`'s. Here the ticks
//! are always due, and a loop that polls plays the executor.

use core::future::{Future, ready};
use core::pin::pin;
use core::task::{Context, Poll, Waker};

use kestrel_core::attitude::Attitude;
use kestrel_core::nalgebra::Vector3;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{Aligned, PolicyError, PolicyFile};
use kestrel_core::vehicle::State;

static POLICY: Aligned<{ include_bytes!("../../assets/pilots/cross.kestrel").len() }> =
    Aligned(*include_bytes!("../../assets/pilots/cross.kestrel"));

/// As `embassy_time::Ticker`: completes once per period.
struct Ticker {
    period_secs: f32,
}

impl Ticker {
    fn next(&mut self) -> impl Future<Output = f32> {
        ready(self.period_secs)
    }
}

/// The control task: `#[embassy_executor::task]`.
async fn control(mut pilot: Pilot<'static>, periods: u32) -> [f32; 4] {
    let mut ticker = Ticker { period_secs: pilot.policy().metadata().control_period_secs };
    let measurements = [0.0; 128];
    let measured = pilot.policy().metadata().observation.measured_len();
    let mut rotor_targets = [0.0; 4];
    for _ in 0..periods {
        ticker.next().await;
        let state = State {
            position: Vector3::new(0.0, 0.0, 0.9),
            world_from_body: Attitude::level(),
            velocity: Vector3::zeros(),
            body_rates: Vector3::zeros(),
            rotor_speeds: [0.0; 4],
        };
        rotor_targets = pilot.tick_measured(&measurements[..measured], &state, &Vector3::new(0.0, 0.0, 1.0));
    }
    rotor_targets
}

fn main() -> Result<(), PolicyError> {
    let mut pilot = Pilot::new(PolicyFile::parse(&POLICY.0)?);
    pilot.self_test()?;
    let mut task = pin!(control(pilot, 100));
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(rotor_targets) = task.as_mut().poll(&mut context) {
            println!("rotor targets {rotor_targets:.0?} rad/s");
            return Ok(());
        }
    }
}
