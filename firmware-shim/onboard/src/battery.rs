//! The simulated battery.

use crate::settings::AutopilotSettings;

/// Voltage of a full and of an empty cell \[V\], for ground stations that show one; in between it is taken as linear.
const VOLTAGES: [f32; 2] = [4.2, 3.0];

/// What is left of a battery that empties in flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Battery {
    remaining: f32,
}

impl Battery {
    /// A full one.
    pub const fn full() -> Self {
        Self { remaining: 1.0 }
    }

    /// One of which a share is left, in \[0, 1\].
    pub const fn left(remaining: f32) -> Self {
        Self { remaining }
    }

    /// Flies for so many seconds.
    pub fn drain(&mut self, secs: f32, settings: &AutopilotSettings) {
        if let Some(drain_secs) = settings.battery_drain_secs {
            let least = settings.battery_least.min(self.remaining);
            self.remaining = (self.remaining - secs / drain_secs).max(least);
        }
    }

    /// Share that is left, of one.
    pub const fn remaining(&self) -> f32 {
        self.remaining
    }

    /// \[V\].
    pub fn voltage(&self) -> f32 {
        let [full, empty] = VOLTAGES;
        empty + (full - empty) * self.remaining
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_empties_in_its_time_down_to_its_least() {
        let settings = AutopilotSettings {
            battery_drain_secs: Some(100.0),
            battery_least: 0.2,
            ..AutopilotSettings::default()
        };
        let mut battery = Battery::full();
        for _ in 0..5000 {
            battery.drain(0.01, &settings);
        }
        assert!((battery.remaining() - 0.5).abs() < 1e-3);
        for _ in 0..5000 {
            battery.drain(0.01, &settings);
        }
        assert!((battery.remaining() - 0.2).abs() < 1e-6);
        battery.drain(1.0, &AutopilotSettings { battery_least: 0.9, ..settings });
        assert!((battery.remaining() - 0.2).abs() < 1e-6, "it is not charged by a parameter");
    }

    #[test]
    fn by_default_it_lasts() {
        let mut battery = Battery::full();
        battery.drain(1e6, &AutopilotSettings::default());
        assert_eq!((battery.remaining(), battery.voltage()), (1.0, 4.2));
    }
}
