//! From the colours of an image to what a canvas takes.

/// Red, green, blue, opacity of a picture of so many columns and rows, each pixel the mean of `samples` × `samples` colours.
pub(crate) fn rgba(colours: &[[u8; 3]], [columns, rows]: [usize; 2], samples: usize) -> Vec<u8> {
    if samples <= 1 {
        return colours.iter().flat_map(|[red, green, blue]| [*red, *green, *blue, u8::MAX]).collect();
    }
    let mut pixels = Vec::with_capacity(4 * columns * rows);
    let mut sums = vec![[0_u16; 3]; columns];
    let count = (samples * samples) as u16;
    for lines in colours.chunks_exact(columns * samples * samples).take(rows) {
        sums.fill([0; 3]);
        for line in lines.chunks_exact(columns * samples) {
            for (sum, pixel) in sums.iter_mut().zip(line.chunks_exact(samples)) {
                for colour in pixel {
                    (0..3).for_each(|channel| sum[channel] += u16::from(colour[channel]));
                }
            }
        }
        for sum in &sums {
            pixels.extend(sum.map(|sum| (sum / count) as u8));
            pixels.push(u8::MAX);
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_the_mean_of_its_samples() {
        let colours: Vec<[u8; 3]> = (0..8).map(|value| [10 * value, 0, 200]).collect();
        assert_eq!(rgba(&colours, [2, 1], 2), [25, 0, 200, 255, 45, 0, 200, 255]);
        assert_eq!(rgba(&colours[..2], [2, 1], 1), [0, 0, 200, 255, 10, 0, 200, 255]);
    }
}
