//! Which host instructions compute the lanes.

use core::fmt;
use core::str::FromStr;

/// Host instructions that compute the lanes. Results do not depend on it, only host time does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HostSimd {
    /// AVX-512: registers of 512 bits, and masks.
    Avx512,
    /// AVX2: registers of 256 bits, with fused multiply-add.
    Avx2,
    /// Plain loops: the `Scalar` back end, and the definition of every operation.
    Portable,
}

impl HostSimd {
    /// All sets of host instructions, fastest first.
    pub const ALL: [HostSimd; 3] = [HostSimd::Avx512, HostSimd::Avx2, HostSimd::Portable];

    /// The fastest set of host instructions that this host has.
    pub fn detect() -> HostSimd {
        HostSimd::ALL.into_iter().find(|simd| simd.is_available()).unwrap_or(HostSimd::Portable)
    }

    /// Whether this host has these instructions.
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            HostSimd::Avx512 => {
                HostSimd::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512cd")
            }
            #[cfg(target_arch = "x86_64")]
            HostSimd::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("fma")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("lzcnt")
                    && is_x86_feature_detected!("popcnt")
            }
            #[cfg(not(target_arch = "x86_64"))]
            HostSimd::Avx512 | HostSimd::Avx2 => false,
            HostSimd::Portable => true,
        }
    }
}

impl fmt::Display for HostSimd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            HostSimd::Avx512 => "avx512",
            HostSimd::Avx2 => "avx2",
            HostSimd::Portable => "portable",
        })
    }
}

impl FromStr for HostSimd {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        HostSimd::ALL
            .into_iter()
            .find(|simd| simd.to_string() == text)
            .ok_or_else(|| format!("'{text}' is no host SIMD level; it must be avx512, avx2 or portable"))
    }
}
