//! Synthetic trenches with noise give back the process that cut them.
#![allow(clippy::unwrap_used, reason = "helpers of tests may unwrap")]

use lasergym_milling::{
    FeedSpeedLaw, Footprint, MillingError, Process, Profile, RemovalLaw, SlopeLaw, Trench,
    calibrate, trench_depths_um,
};

/// Noise of about unit variance: the sum of twelve values of a linear congruential generator.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            sum += (self.0 >> 11) as f64 / (1_u64 << 53) as f64;
        }
        sum
    }
}

fn trenches(process: &Process, speeds: &[f64], noise_um: f64) -> Vec<Trench> {
    let reach = process.footprint.reach_um();
    let y_um: Vec<f64> = (-60..=60).map(|k| f64::from(k) / 50.0 * reach).collect();
    let mut noise = Noise(7);
    speeds
        .iter()
        .map(|&speed_mm_s| {
            let mut depth_um = trench_depths_um(process, speed_mm_s, &y_um).unwrap();
            for depth in &mut depth_um {
                *depth += noise_um * noise.next();
            }
            // Nobody knows where exactly the centre is.
            let y_um = y_um.iter().map(|y| y + 0.03 * reach).collect();
            Trench { speed_mm_s, y_um, depth_um }
        })
        .collect()
}

fn check(truth: &Process, start: &Process, speeds: &[f64], noise_um: f64, expected: &[f64]) {
    let found = calibrate(start, &trenches(truth, speeds, noise_um)).unwrap();
    assert!((found.rms_um / noise_um - 1.0).abs() < 0.2, "{found:?}");
    assert_eq!(found.parameters.len(), expected.len());
    for (parameter, expected) in found.parameters.iter().zip(expected) {
        let off = (parameter.value - expected).abs();
        assert!(off < 2.0 * parameter.confidence_95, "{parameter:?} for {expected}");
        assert!(parameter.confidence_95 < 0.25 * expected.abs(), "{parameter:?}");
    }
}

#[test]
fn a_laser_is_recovered() {
    let law =
        |exponent| RemovalLaw::FeedSpeed(FeedSpeedLaw { exponent, ..FeedSpeedLaw::default() });
    let truth = Process { footprint: Footprint::gaussian(6e4, 20.0).unwrap(), law: law(0.42) };
    let start = Profile::shipped("laser-graphite").unwrap().process;
    check(&truth, &start, &[200.0, 400.0, 800.0], 0.05, &[6e4, 20.0, 0.42]);
}

#[test]
fn a_jet_is_recovered() {
    let truth = Process {
        footprint: Footprint::compact(4.4e3, 330.0).unwrap(),
        law: RemovalLaw::Slope(SlopeLaw {
            first_per_rad: 0.45,
            second_per_rad2: 0.2,
            ..SlopeLaw::default()
        }),
    };
    let start = Profile::shipped("waterjet-garnet").unwrap().process;
    check(&truth, &start, &[4.0, 8.0, 60.0], 0.2, &[4.4e3, 330.0, 0.45, 0.2]);
}

#[test]
fn trenches_that_say_too_little_are_refused() {
    let start = Profile::shipped("laser-graphite").unwrap().process;
    let fault = |trenches: &[Trench]| match calibrate(&start, trenches) {
        Err(MillingError::Calibration { reason }) => reason,
        other => panic!("{other:?}"),
    };
    assert!(fault(&[]).contains("0 depths"));
    assert!(fault(&trenches(&start, &[300.0], 0.1)).contains("speed"));
}
