//! The sticks and switches of a pilot who never moves them.

use std::fmt;
use std::str::FromStr;

/// Most channels.
const CHANNELS: usize = 16;

/// Pulses that receivers deliver \[µs\].
const PULSES_US: core::ops::RangeInclusive<u16> = 800..=2200;

/// Pulses of a remote control, one per channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Radio {
    pulses_us: [u16; CHANNELS],
    len: u8,
}

/// What is no [`Radio`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected 1 to {CHANNELS} pulses from {shortest} to {longest} µs with commas between them, found \"{0}\"",
    shortest = PULSES_US.start(),
    longest = PULSES_US.end()
)]
pub struct RadioError(String);

impl FromStr for Radio {
    type Err = RadioError;

    fn from_str(text: &str) -> Result<Self, RadioError> {
        let wrong = || RadioError(text.to_owned());
        let mut radio = Self { pulses_us: [0; CHANNELS], len: 0 };
        for word in text.split(',') {
            let pulse_us =
                word.trim().parse().ok().filter(|pulse_us| PULSES_US.contains(pulse_us)).ok_or_else(wrong)?;
            *radio.pulses_us.get_mut(usize::from(radio.len)).ok_or_else(wrong)? = pulse_us;
            radio.len += 1;
        }
        Ok(radio)
    }
}

impl fmt::Display for Radio {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for number in 1..=usize::from(self.len) {
            let separator = if number == 1 { "" } else { "," };
            write!(formatter, "{separator}{}", self.pulses_us[number - 1])?;
        }
        Ok(())
    }
}

impl Radio {
    /// The pulse of a channel \[µs\], counted from 1, if there is one.
    pub fn pulse_us(&self, number: usize) -> Option<u16> {
        let channels = self.pulses_us.get(..usize::from(self.len))?;
        channels.get(number.checked_sub(1)?).copied()
    }

    /// How many channels there are.
    #[expect(clippy::len_without_is_empty, reason = "there is always one")]
    pub const fn len(&self) -> u8 {
        self.len
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_counted_from_one() {
        let radio: Radio = "1500,1500,1000,1500,2000".parse().unwrap();
        assert_eq!(radio.len(), 5);
        assert_eq!(
            [0, 1, 3, 5, 6].map(|number| radio.pulse_us(number)),
            [None, Some(1500), Some(1000), Some(2000), None]
        );
        assert_eq!(radio.to_string(), "1500,1500,1000,1500,2000");
    }

    #[test]
    fn what_no_receiver_delivers_is_refused() {
        let seventeen = ["1500"; 17].join(",");
        for wrong in ["", "1500,", "799", "2201", "-1", "stick", seventeen.as_str()] {
            assert!(wrong.parse::<Radio>().unwrap_err().to_string().contains(&format!("found \"{wrong}\"")));
        }
    }
}
