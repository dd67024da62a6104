//! Colours for the order of pulses.

/// The colour at `t` in [0, 1] as `#rrggbb`: dark violet first, over blue, to light cyan.
///
/// Lightness grows evenly in Oklab (Ottosson 2020, "A perceptual color space for image processing"),
/// so equal steps look equal also in grey; no hue is near the picture's yellow, red and green.
pub(crate) fn order_color(t: f64) -> String {
    let t = t.clamp(0.0, 1.0);
    let lightness = 0.28 + 0.50 * t;
    let chroma = 0.15 - 0.03 * t;
    let hue = (305.0 - 90.0 * t).to_radians();
    let [red, green, blue] = srgb(lightness, chroma * hue.cos(), chroma * hue.sin());
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// The 8-bit sRGB colour of Oklab (L, a, b), each channel clipped.
fn srgb(lightness: f64, a: f64, b: f64) -> [u8; 3] {
    let long = (lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b).powi(3);
    let medium = (lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b).powi(3);
    let short = (lightness - 0.089_484_177_5 * a - 1.291_485_548_0 * b).powi(3);
    [
        4.076_741_662_1 * long - 3.307_711_591_3 * medium + 0.230_969_929_2 * short,
        -1.268_438_004_6 * long + 2.609_757_401_1 * medium - 0.341_319_396_5 * short,
        -0.004_196_086_3 * long - 0.703_418_614_7 * medium + 1.707_614_701_0 * short,
    ]
    .map(|linear| (gamma_encoded(linear.clamp(0.0, 1.0)) * 255.0).round() as u8)
}

/// The sRGB transfer curve (IEC 61966-2-1) of a linear value in [0, 1].
fn gamma_encoded(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oklab_agrees_with_known_colors() {
        // Values from Ottosson's page for sRGB white, red and blue.
        assert_eq!(srgb(1.0, 0.0, 0.0), [255, 255, 255]);
        assert_eq!(srgb(0.627_955, 0.224_863, 0.125_846), [255, 0, 0]);
        assert_eq!(srgb(0.452_014, -0.032_457, -0.311_528), [0, 0, 255]);
        assert_eq!(srgb(0.0, 0.0, 0.0), [0, 0, 0]);
    }

    #[test]
    fn brightness_grows_with_order() {
        let brightness = |t: f64| {
            let color = u32::from_str_radix(&order_color(t)[1..], 16).unwrap();
            let [red, green, blue] = [16, 8, 0].map(|shift| f64::from(color >> shift & 255));
            0.2126 * red + 0.7152 * green + 0.0722 * blue
        };
        for k in 0..32 {
            assert!(brightness(f64::from(k) / 32.0) < brightness(f64::from(k + 1) / 32.0));
        }
    }

    #[test]
    fn what_lies_outside_is_clipped() {
        assert_eq!(order_color(-1.0), order_color(0.0));
        assert_eq!(order_color(7.0), order_color(1.0));
    }
}
