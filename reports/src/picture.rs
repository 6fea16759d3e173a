//! Pictures of a frame, and the number that names one.

use std::io::{self, Cursor};

use sha2::{Digest as _, Sha256};

/// The one NaN that stands for "nothing was hit" when values are hashed or dumped.
pub const NOTHING_HIT: f32 = f32::from_bits(0x7fc0_0000);

/// Linear light of a surface that the lamp does not reach.
const AMBIENT: f32 = 0.10;

/// Linear light of a lit surface that faces the lamp: below white, so that bright walls still show their shapes.
const FULL: f32 = 0.80;

/// Linear gray where nothing was hit, at the bottom and at the top of the picture.
const BACKGROUND: [[f32; 3]; 2] = [[0.10, 0.11, 0.13], [0.22, 0.25, 0.30]];

/// SHA-256, in hexadecimal, of visibility values as little-endian f32 with one NaN for "nothing was hit".
///
/// ```
/// let hash = lrbsim_reports::picture::sha256_of_visibility(&[1.0, f32::NAN]);
/// assert_eq!(hash, lrbsim_reports::picture::sha256_of_visibility(&[1.0, -f32::NAN]));
/// ```
pub fn sha256_of_visibility(values: &[f32]) -> String {
    let mut hasher = Sha256::new();
    for value in values {
        hasher.update(canonical(*value).to_le_bytes());
    }
    hex(&hasher.finalize())
}

/// SHA-256 of bytes, in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// SHA-256, in hexadecimal, of everything that `bytes` has to read.
pub fn sha256_of_reader(mut bytes: impl io::Read) -> io::Result<String> {
    let mut hashing = Hashing::new(io::sink());
    io::copy(&mut bytes, &mut hashing)?;
    Ok(hashing.end().1)
}

/// A writer that hashes what it passes on.
pub(crate) struct Hashing<W> {
    out: W,
    hasher: Sha256,
}

impl<W: io::Write> Hashing<W> {
    pub(crate) fn new(out: W) -> Hashing<W> {
        Hashing { out, hasher: Sha256::new() }
    }

    /// What it wrote to, and the SHA-256 of all that was written, in hexadecimal.
    pub(crate) fn end(self) -> (W, String) {
        (self.out, hex(&self.hasher.finalize()))
    }
}

impl<W: io::Write> io::Write for Hashing<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.hasher.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

fn hex(digest: &[u8]) -> String {
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// `value`, or the one NaN.
pub(crate) fn canonical(value: f32) -> f32 {
    if value.is_nan() { NOTHING_HIT } else { value }
}

/// A frame as a viewer sees it: visibility of the light times the cosine at the surface, and a background.
///
/// Row-major from the top left; `visibility` is NaN where nothing was hit; `cosine` is between the surface's normal and
/// the direction to the light's center, in [-1, 1].
///
/// # Panics
/// When a slice has not `width * height` values.
pub fn shaded_png(width: u32, height: u32, visibility: &[f32], cosine: &[f32]) -> Vec<u8> {
    rgb_png(width, height, &shaded_rgb(width, height, visibility, cosine))
}

/// The pixels of [`shaded_png`]: red, green and blue, 8 bits each.
///
/// # Panics
/// When a slice has not `width * height` values.
pub fn shaded_rgb(width: u32, height: u32, visibility: &[f32], cosine: &[f32]) -> Vec<u8> {
    assert_eq!((visibility.len(), cosine.len()), (pixels(width, height), pixels(width, height)));
    let mut rgb = Vec::with_capacity(3 * visibility.len());
    for (index, (lit, cosine)) in visibility.iter().zip(cosine).enumerate() {
        if lit.is_nan() {
            let row = index / width as usize;
            let up = 1.0 - row as f32 / height.max(2) as f32;
            rgb.extend((0..3).map(|c| encode(BACKGROUND[0][c] * (1.0 - up) + BACKGROUND[1][c] * up)));
        } else {
            // Half of the ambient light depends on the surface too, so that shapes show inside an umbra.
            let facing = cosine.max(0.0);
            let ambient = AMBIENT * (0.75 + 0.25 * cosine);
            let gray = encode(ambient + (FULL - AMBIENT) * lit.clamp(0.0, 1.0) * facing);
            rgb.extend([gray, gray, gray]);
        }
    }
    rgb
}

/// Visibility alone, linear: 0 umbra is black, 1 lit is white; black where nothing was hit.
///
/// # Panics
/// When the slice has not `width * height` values.
pub fn visibility_png(width: u32, height: u32, visibility: &[f32]) -> Vec<u8> {
    assert_eq!(visibility.len(), pixels(width, height));
    let gray: Vec<u8> =
        visibility.iter().map(|value| quantize(if value.is_nan() { 0.0 } else { *value })).collect();
    png(width, height, &gray, image::ExtendedColorType::L8)
}

/// Errors from which on [`error_png`] shows the last color of its scale.
pub const ERROR_SCALE_END: f32 = 0.25;

/// Colors of an error that grows from 0 to [`ERROR_SCALE_END`] in equal steps, for a picture that is too dark and for one that
/// is too light. Equal steps in the lightness of Oklab: as the eye takes them.
pub const ERROR_COLORS: [[[u8; 3]; 9]; 2] = [
    [
        [18, 18, 18],
        [24, 37, 50],
        [27, 57, 86],
        [28, 77, 124],
        [25, 99, 164],
        [52, 122, 189],
        [76, 146, 214],
        [100, 170, 241],
        [125, 195, 255],
    ],
    [
        [18, 18, 18],
        [47, 31, 21],
        [79, 45, 20],
        [113, 59, 13],
        [148, 73, 0],
        [173, 96, 32],
        [199, 119, 59],
        [225, 143, 84],
        [252, 167, 108],
    ],
];

/// Where a picture of visibility is too dark (blue) or too light (orange), and by how much: from nearly black, where it is
/// right, to the brightest colors at an error of 0.25 or more. Gray where nothing was hit.
///
/// # Panics
/// When a slice has not `width * height` values.
pub fn error_png(width: u32, height: u32, visibility: &[f32], truth: &[f32]) -> Vec<u8> {
    rgb_png(width, height, &error_rgb(width, height, visibility, truth))
}

/// The pixels of [`error_png`]: red, green and blue, 8 bits each.
///
/// # Panics
/// When a slice has not `width * height` values.
pub fn error_rgb(width: u32, height: u32, visibility: &[f32], truth: &[f32]) -> Vec<u8> {
    assert_eq!((visibility.len(), truth.len()), (pixels(width, height), pixels(width, height)));
    let color = |(test, truth): (&f32, &f32)| if test.is_nan() { [90; 3] } else { error_color(test - truth) };
    visibility.iter().zip(truth).flat_map(color).collect()
}

/// Red, green and blue, 8 bits each, as a PNG of at most `most` pixels a side: a larger picture is averaged down.
///
/// # Panics
/// When the slice has not `3 * width * height` values.
pub fn small_png(width: u32, height: u32, rgb: Vec<u8>, most: u32) -> Vec<u8> {
    let picture = image::RgbImage::from_raw(width, height, rgb).expect("3 * width * height values");
    let part = (f64::from(most) / f64::from(width.max(height))).min(1.0);
    let side = |pixels: u32| ((f64::from(pixels) * part).round() as u32).max(1);
    let small = image::imageops::thumbnail(&picture, side(width), side(height));
    rgb_png(small.width(), small.height(), small.as_raw())
}

fn error_color(error: f32) -> [u8; 3] {
    let colors = &ERROR_COLORS[usize::from(error > 0.0)];
    let last = colors.len() - 1;
    let place = (error.abs() / ERROR_SCALE_END).min(1.0) * last as f32;
    // A float-to-integer cast rounds down.
    let step = (place as usize).min(last - 1);
    let between = place - step as f32;
    let mix = |low: u8, high: u8| (f32::from(low) * (1.0 - between) + f32::from(high) * between + 0.5) as u8;
    std::array::from_fn(|c| mix(colors[step][c], colors[step + 1][c]))
}

/// Red, green and blue, 8 bits each, as a PNG.
///
/// # Panics
/// When the slice has not `3 * width * height` values.
pub fn rgb_png(width: u32, height: u32, rgb: &[u8]) -> Vec<u8> {
    assert_eq!(rgb.len(), 3 * pixels(width, height));
    png(width, height, rgb, image::ExtendedColorType::Rgb8)
}

fn pixels(width: u32, height: u32) -> usize {
    width as usize * height as usize
}

/// sRGB code of a linear value. The square root stands in for the curve: exactly defined on every host.
fn encode(linear: f32) -> u8 {
    quantize(linear.max(0.0).sqrt())
}

fn quantize(value: f32) -> u8 {
    // A float-to-integer cast saturates.
    (value * 255.0 + 0.5) as u8
}

fn png(width: u32, height: u32, bytes: &[u8], color: image::ExtendedColorType) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    image::write_buffer_with_format(&mut file, bytes, width, height, color, image::ImageFormat::Png)
        .expect("a buffer of the right size is encoded into memory");
    file.into_inner()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_of_visibility_is_that_of_its_little_endian_bytes() {
        let bytes: Vec<u8> =
            [0x3f80_0000_u32, 0x7fc0_0000].iter().flat_map(|bits| bits.to_le_bytes()).collect();
        assert_eq!(sha256_of_visibility(&[1.0, f32::NAN]), sha256(&bytes));
    }

    #[test]
    fn a_penumbra_lies_between_light_and_umbra() {
        let bytes = shaded_png(4, 1, &[0.0, 0.5, 1.0, f32::NAN], &[1.0; 4]);
        let picture = image::load_from_memory(&bytes).expect("a PNG").to_rgb8();
        let gray: Vec<u8> = (0..3).map(|x| picture.get_pixel(x, 0)[0]).collect();
        assert!(gray[0] < gray[1] && gray[1] < gray[2], "{gray:?}");
        assert!(gray[0] > 0, "an umbra still shows shapes");
        assert_ne!(picture.get_pixel(3, 0)[0], picture.get_pixel(3, 0)[2], "the background is not gray");
    }

    #[test]
    fn a_picture_of_errors_tells_their_sign_and_their_size() {
        let bytes =
            error_png(6, 1, &[0.5, 0.5, 0.4, 0.7, 1.0, f32::NAN], &[0.5, 0.6, 0.6, 0.5, 0.0, f32::NAN]);
        let picture = image::load_from_memory(&bytes).expect("a PNG").to_rgb8();
        let pixel = |x| picture.get_pixel(x, 0).0;
        assert_eq!((pixel(0), pixel(4), pixel(5)), ([18; 3], [252, 167, 108], [90; 3]));
        let sum = |x: u32| pixel(x).iter().map(|c| u32::from(*c)).sum::<u32>();
        assert!(sum(0) < sum(1) && sum(1) < sum(2) && pixel(2)[2] > pixel(2)[0], "too dark is blue");
        assert!(pixel(3)[0] > pixel(3)[2], "too light is orange");
    }

    #[test]
    fn a_small_picture_has_the_mean_of_a_large_one() {
        let rgb: Vec<u8> =
            (0..400_u32).flat_map(|i| if i % 2 == 0 { [200, 100, 0] } else { [0; 3] }).collect();
        let small = image::load_from_memory(&small_png(20, 20, rgb.clone(), 10)).expect("a PNG").to_rgb8();
        assert_eq!(small.dimensions(), (10, 10));
        assert!(small.pixels().all(|pixel| pixel.0[0].abs_diff(100) < 3 && pixel.0[2] == 0));
        let same = image::load_from_memory(&small_png(20, 20, rgb.clone(), 320)).expect("a PNG").to_rgb8();
        assert_eq!(same.into_raw(), rgb);
    }

    #[test]
    fn pure_visibility_is_linear() {
        let bytes = visibility_png(4, 1, &[0.0, 0.5, 1.0, f32::NAN]);
        assert_eq!(image::load_from_memory(&bytes).expect("a PNG").to_luma8().into_raw(), [0, 128, 255, 0]);
    }
}
