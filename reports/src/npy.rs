//! Dumps in NumPy's array format, version 1.0.

use crate::picture::canonical;

/// An array of little-endian f32 in C order as the bytes of an `.npy` file; every NaN becomes the same one.
///
/// ```
/// let bytes = lrbsim_reports::npy::f32_array(&[2, 3], &[0.0; 6]);
/// assert_eq!((&bytes[..6], bytes.len()), (&b"\x93NUMPY"[..], 128 + 24));
/// ```
///
/// # Panics
/// When `values` has not as many values as `shape` says.
pub fn f32_array(shape: &[usize], values: &[f32]) -> Vec<u8> {
    assert_eq!(shape.iter().product::<usize>(), values.len(), "shape {shape:?}");
    let shape: String = shape.iter().map(|extent| format!("{extent}, ")).collect();
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", shape.trim_end());
    // Magic, version and length take 10 bytes; the data starts at a multiple of 64; a line break ends the header.
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let length = u16::try_from(header.len()).expect("a shape takes less than 64 KiB");

    let mut bytes = Vec::with_capacity(10 + header.len() + 4 * values.len());
    bytes.extend(b"\x93NUMPY\x01\x00");
    bytes.extend(length.to_le_bytes());
    bytes.extend(header.as_bytes());
    for value in values {
        bytes.extend(canonical(*value).to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_is_one_that_numpy_reads() {
        let bytes = f32_array(&[2, 1, 3], &[1.0, 2.0, 3.0, 4.0, 5.0, f32::NAN]);
        assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
        let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let header = std::str::from_utf8(&bytes[10..10 + length]).expect("ASCII");
        assert_eq!(header.trim_end(), "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 1, 3,), }");
        assert!(header.ends_with('\n') && (10 + length).is_multiple_of(64));
        assert_eq!(bytes.len(), 10 + length + 24);
        assert_eq!(&bytes[10 + length + 20..], 0x7fc0_0000_u32.to_le_bytes());
    }

    #[test]
    fn one_dimension_is_a_tuple_too() {
        let bytes = f32_array(&[4], &[0.0; 4]);
        assert!(String::from_utf8_lossy(&bytes).contains("'shape': (4,), }"));
    }
}
