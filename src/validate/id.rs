//! The parts of an id.

/// The number behind `prefix`, such as 16 in `t016`.
pub(super) fn number(text: &str, prefix: &str) -> Option<u32> {
    let digits = text.strip_prefix(prefix)?;
    (!digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit())).then(|| digits.parse().ok())?
}

/// Bytes of a size such as `64`, `512k`, `1m` or `128mb`.
pub(super) fn bytes(text: &str) -> Option<u64> {
    let text = text.strip_suffix('b').unwrap_or(text);
    let (digits, unit) = match text.strip_suffix('k') {
        Some(digits) => (digits, 1 << 10),
        None => text.strip_suffix('m').map_or((text, 1), |digits| (digits, 1 << 20)),
    };
    u64::from(number(digits, "")?).checked_mul(unit)
}

/// Count and stride of a pattern such as `8x64k`.
pub(super) fn pattern(text: &str) -> Option<(u32, u32)> {
    let (count, stride) = text.split_once('x')?;
    Some((number(count, "")?, u32::try_from(bytes(stride)?).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_ids_are_read() {
        assert_eq!(
            (number("t016", "t"), number("core08", "core"), number("t", "t")),
            (Some(16), Some(8), None)
        );
        assert_eq!((number("t-1", "t"), number("t+1", "t"), number("x1", "t")), (None, None, None));
        assert_eq!(
            (bytes("64"), bytes("512k"), bytes("1m"), bytes("128mb")),
            (Some(64), Some(512 << 10), Some(1 << 20), Some(128 << 20))
        );
        assert_eq!((pattern("8x64k"), pattern("8"), pattern("x4k")), (Some((8, 65536)), None, None));
    }
}
