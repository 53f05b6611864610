//! Pictures to GIF.

use std::borrow::Cow;

use gif::{DisposalMethod, Encoder, EncodingError, Frame, Repeat};

use super::playback::PICTURE_SECS;
use super::{SIZE, palette};

/// How long the last picture stays before the film starts again \[s\].
const PAUSE_SECS: f32 = 1.5;

/// GIF of pictures of [`SIZE`] in palette colours, endlessly repeated.
pub(super) fn gif(pictures: &[Vec<u8>]) -> Result<Vec<u8>, EncodingError> {
    let mut encoder = Encoder::new(Vec::new(), SIZE[0] as u16, SIZE[1] as u16, &palette::bytes())?;
    encoder.set_repeat(Repeat::Infinite)?;
    for (index, picture) in pictures.iter().enumerate() {
        let before = index.checked_sub(1).map(|before| &pictures[before][..]);
        let mut frame = smallest(before, picture);
        let pause = if index + 1 == pictures.len() { PAUSE_SECS } else { 0.0 };
        frame.delay = ((PICTURE_SECS + pause) * 100.0).round() as u16;
        encoder.write_lzw_pre_encoded_frame(&frame)?;
    }
    encoder.into_inner()
}

/// The shortest way to write a picture over the one before.
fn smallest(before: Option<&[u8]>, picture: &[u8]) -> Frame<'static> {
    let Some(before) = before else { return encoded([0, 0, SIZE[0], SIZE[1]], picture.to_vec(), None) };
    let changed = changed_area(before, picture);
    let whole = crop(picture, changed);
    let differences = crop(before, changed)
        .into_iter()
        .zip(&whole)
        .map(|(old, &new)| if old == new { palette::UNCHANGED } else { new })
        .collect();
    let candidates = [encoded(changed, whole, None), encoded(changed, differences, Some(palette::UNCHANGED))];
    let [plain, sparse] = candidates;
    if sparse.buffer.len() < plain.buffer.len() { sparse } else { plain }
}

fn encoded([left, top, width, height]: [usize; 4], pixels: Vec<u8>, transparent: Option<u8>) -> Frame<'static> {
    let mut frame = Frame {
        left: left as u16,
        top: top as u16,
        width: width as u16,
        height: height as u16,
        buffer: Cow::Owned(pixels),
        transparent,
        dispose: DisposalMethod::Keep,
        ..Frame::default()
    };
    frame.make_lzw_pre_encoded();
    frame
}

/// Smallest `[left, top, width, height]` that holds every changed pixel; one pixel when none has changed.
fn changed_area(before: &[u8], picture: &[u8]) -> [usize; 4] {
    let [width, _] = SIZE;
    let changed = || (0..picture.len()).filter(|&pixel| before[pixel] != picture[pixel]);
    let columns = || changed().map(|pixel| pixel % width);
    let rows = || changed().map(|pixel| pixel / width);
    let (left, right) = (columns().min().unwrap_or(0), columns().max().unwrap_or(0));
    let (top, bottom) = (rows().min().unwrap_or(0), rows().max().unwrap_or(0));
    [left, top, right - left + 1, bottom - top + 1]
}

fn crop(picture: &[u8], [left, top, width, height]: [usize; 4]) -> Vec<u8> {
    let rows = (top..top + height).map(|row| row * SIZE[0] + left);
    rows.flat_map(|start| &picture[start..start + width]).copied().collect()
}
