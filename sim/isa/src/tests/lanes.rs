//! What the host's lanes do for the recorder, against the portable ones.

use super::{Random, levels};
use crate::host::HostSimd;
use crate::lanes::{Lanes, Portable};

#[test]
fn blocks_of_register_pressure_agree_with_their_definition() {
    fn check<L: Lanes>(at: &str) {
        let mut random = Random(0x1234_5678_9abc_def1);
        for round in 0..2000 {
            let sparse = 1 + round % 4;
            let made = core::array::from_fn(|_| if random.below(sparse) == 0 { random.word() } else { 0 });
            let ended = core::array::from_fn(|_| random.below(if round == 0 { 256 } else { 4 }) as u8);
            assert_eq!(L::rise(&made, &ended), Portable::rise(&made, &ended), "{at} {made:?} {ended:?}");
        }
        assert_eq!(L::rise(&[0; 16], &[255; 16]), (-255, -16 * 255), "{at}");
        assert_eq!(L::rise(&[u32::MAX; 16], &[0; 16]), (16, 16), "{at}");
    }
    fn check_distinct<L: Lanes>(at: &str) {
        let mut random = Random(0xfeed_5678_9abc_def1);
        for round in 0..20_000 {
            let span = 1 + random.below(40);
            let offset = if round % 3 == 0 { -20 } else { 1 << 20 };
            let values: [i32; 16] = core::array::from_fn(|_| random.below(span) as i32 + offset);
            let k = random.mask();
            let first = Portable::distinct(k, values);
            assert_eq!(L::distinct(k, L::from_i(values)), first, "{at} {k:#x} {values:?}");
            let mut stored = [0; 16];
            #[expect(unsafe_code, reason = "room for 16 words")]
            // SAFETY: `stored` has 16 words.
            let count = unsafe { L::store_distinct(k, stored.as_mut_ptr(), L::from_i(values)) };
            let expected: Vec<i32> = (0..16).filter(|i| first >> i & 1 == 1).map(|i| values[i]).collect();
            assert_eq!(&stored[..count as usize], expected, "{at} {k:#x} {values:?}");
        }
    }
    for simd in levels() {
        let at = simd.to_string();
        match simd {
            #[cfg(target_arch = "x86_64")]
            HostSimd::Avx512 => {
                check::<crate::lanes::Avx512>(&at);
                check_distinct::<crate::lanes::Avx512>(&at);
            }
            #[cfg(target_arch = "x86_64")]
            HostSimd::Avx2 => {
                check::<crate::lanes::Avx2>(&at);
                check_distinct::<crate::lanes::Avx2>(&at);
            }
            _ => check_distinct::<Portable>(&at),
        }
    }
}
