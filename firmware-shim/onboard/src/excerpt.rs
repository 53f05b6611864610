//! What was found where something else was expected, short enough for an error message without allocation.

use core::fmt;

/// Longer findings are cut after so many bytes.
const LIMIT: usize = 32;

/// The beginning of a text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Excerpt {
    text: heapless::String<LIMIT>,
    whole_len: usize,
}

impl From<&str> for Excerpt {
    fn from(text: &str) -> Self {
        let mut excerpt = Self { text: heapless::String::new(), whole_len: text.len() };
        for letter in text.chars() {
            if excerpt.text.push(letter).is_err() {
                break;
            }
        }
        excerpt
    }
}

impl fmt::Display for Excerpt {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rest = if self.text.len() < self.whole_len { "..." } else { "" };
        write!(formatter, "\"{}{rest}\"", self.text.escape_debug())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_text_is_quoted_whole_and_long_text_cut_between_letters() {
        assert_eq!(Excerpt::from("a\tb").to_string(), "\"a\\tb\"");
        let long = "é".repeat(40);
        assert_eq!(Excerpt::from(long.as_str()).to_string(), format!("\"{}...\"", "é".repeat(16)));
    }
}
