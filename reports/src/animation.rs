//! Pictures that follow one another in one file: an animated PNG, which browsers play and everybody else shows the
//! first frame of.

/// Frames a second.
const RATE: u16 = 8;

/// Pictures of one size, red, green and blue, as an animation that repeats.
///
/// # Panics
/// When there is no picture, or one has not `3 * width * height` values.
pub fn animated_png(width: u32, height: u32, frames: &[Vec<u8>]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let count = u32::try_from(frames.len()).expect("a film is shorter");
    encoder.set_animated(count, 0).expect("there is a frame");
    encoder.set_frame_delay(1, RATE).expect("the animation was set");
    let mut writer = encoder.write_header().expect("memory takes everything");
    for frame in frames {
        writer.write_image_data(frame).expect("frames are of the size that was told");
    }
    writer.finish().expect("memory takes everything");
    file
}

#[cfg(test)]
mod tests {
    #[test]
    fn every_frame_is_in_the_file() {
        let frames = [vec![0; 12], vec![255; 12], vec![7; 12]];
        let bytes = super::animated_png(2, 2, &frames);
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().expect("a PNG");
        assert_eq!(reader.info().animation_control.expect("animated").num_frames, 3);
        let mut pixels = vec![0; reader.output_buffer_size().expect("small")];
        for frame in &frames {
            reader.next_frame(&mut pixels).expect("a frame");
            assert_eq!(&pixels, frame);
        }
    }
}
