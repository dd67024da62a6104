//! Jobs of every kind become programs that do what was asked, or a reason why not.

use lasergym_galvo::{
    AnyProgram, GalvoError, HeadKnowledge, JobReader, LaserControl, Method, Observer, PostOptions,
    ProgramFormat, ProgramReader, PulseLanding, ScanHead, postprocess_text,
};
use lasergym_geom::Point;
use lasergym_toolpath::{
    DwellPass, DwellPoint, GcodeOptions, PulsePath, ToolpathError, write_csv, write_gcode,
    write_passes_csv,
};

struct Pulses(Vec<PulseLanding>);

impl Observer for Pulses {
    fn pulse(&mut self, pulse: &PulseLanding) {
        self.0.push(*pulse);
    }
}

/// Where the pulses of a job land, µm.
fn landings(name: &str, job: &str, options: &PostOptions) -> Result<Vec<Point>, GalvoError> {
    let head = ScanHead::default();
    let knowledge = HeadKnowledge::of_head(&head);
    let format = ProgramFormat::of_name("grbl")?;
    let (text, _) = postprocess_text(&head, &knowledge, options, (name, job), format, 255.0)?;
    let program = AnyProgram::of_name("job.nc", text.as_bytes(), &head)?;
    let pulses = program.play(&head, Pulses(Vec::new()))?.0.0;
    Ok(pulses.iter().map(|pulse| pulse.position_um).collect())
}

fn plan() -> Result<PulsePath, ToolpathError> {
    let places =
        [(50.0, 50.0), (12.5, 12.75), (56.2, 99.4), (33.3, 33.3), (33.3, 33.3), (0.0, 1.0)];
    PulsePath::new(places.iter().map(|&(x, y)| Point::new(x, y)).collect(), 9.0)
}

#[test]
fn a_plan_gives_one_pulse_at_each_place() {
    let plan = plan().unwrap();
    for (beam_um, speed, control) in [
        (40.0, 2.0, LaserControl::Delays),
        (0.0, 0.01, LaserControl::Delays),
        (9.0, 0.5, LaserControl::Inline),
    ] {
        let options = PostOptions {
            beam_um,
            control,
            speed_m_s: Some(speed),
            delay_step_us: 0.0,
            ..PostOptions::default()
        };
        let found = landings("plan.csv", &write_csv(&plan), &options).unwrap();
        assert_eq!(found.len(), plan.len());
        for (pulse, place) in found.iter().zip(plan.positions_px()) {
            let apart_um = pulse.distance(Point::new(place.x, -place.y));
            assert!(apart_um < 2.0, "{speed} m/s: {apart_um} µm");
        }
    }
}

#[test]
fn a_stage_program_of_a_plan_gives_its_pulses_too() {
    let plan = plan().unwrap();
    let frame = GcodeOptions::default();
    let options = PostOptions { speed_m_s: Some(1.0), ..PostOptions::default() };
    let found = landings("plan.nc", &write_gcode(&plan, &frame).unwrap(), &options).unwrap();
    assert_eq!(found.len(), plan.len());
    // The program lies elsewhere, with y up: distances are the same.
    let places = plan.positions_px();
    for (pulses, drawn) in found.windows(2).zip(places.windows(2)) {
        let (made, asked) = (pulses[0].distance(pulses[1]), drawn[0].distance(drawn[1]));
        assert!((made - asked).abs() < 4.0, "{made} {asked}");
    }
}

#[test]
fn pulses_fire_without_compensation_too() {
    for method in [Method::None, Method::DelaysOnly] {
        let options = PostOptions { method, speed_m_s: Some(1.0), ..PostOptions::default() };
        let found = landings("plan.csv", &write_csv(&plan().unwrap()), &options).unwrap();
        assert_eq!(found.len(), plan().unwrap().len(), "{method:?}");
    }
}

#[test]
fn pulses_need_a_speed() {
    let refused = landings("plan.csv", &write_csv(&plan().unwrap()), &PostOptions::default());
    assert!(matches!(refused, Err(GalvoError::SpeedUnknown { vector: 1 })));
}

#[test]
fn passes_are_strokes() {
    let point = |x_um: f64, beam_on| DwellPoint { x_um, y_um: 300.0, speed_mm_s: 1e3, beam_on };
    let points = vec![point(-500.0, false), point(500.0, true)];
    let csv = write_passes_csv(&[DwellPass { points }]).unwrap();
    let origin_um = Point::new(2000.0, 1000.0);
    let options = PostOptions { pitch_um: Some(20.0), origin_um, ..PostOptions::default() };
    let found = landings("passes.csv", &csv, &options).unwrap();
    // Crater centres begin half a crater behind the start.
    let (first, last) = (found[0], found[found.len() - 1]);
    assert!(first.distance(Point::new(1520.0, 700.0)) < 2.0, "{first:?}");
    assert!(last.distance(Point::new(2480.0, 700.0)) < 2.0, "{last:?}");
    assert_eq!(found.len(), 49);
}

#[test]
fn the_origin_moves_everything() {
    let job = "FEDRAT/60000\nRAPID\nGOTO/0,0\nGOTO/1,0\nRAPID\nGOTO/0,0\nCIRCLE/1,0,0,0,0,1,1\nGOTO/1,1\n";
    let here = landings("job.apt", job, &PostOptions::default()).unwrap();
    let origin_um = Point::new(-3000.0, 4000.0);
    let there =
        landings("job.apt", job, &PostOptions { origin_um, ..PostOptions::default() }).unwrap();
    assert_eq!(here.len(), there.len());
    assert!(here.iter().zip(&there).all(|(a, b)| (*a + origin_um).distance(*b) < 0.01));
    let origin_um = Point::new(f64::NAN, 0.0);
    let refused = landings("job.apt", job, &PostOptions { origin_um, ..PostOptions::default() });
    assert!(refused.unwrap_err().to_string().starts_with("origin_x_um"));
}

#[test]
fn a_vector_so_slow_that_no_controller_knows_its_delay_is_refused() {
    // Half a beam of 40 µm takes 0.1 s at 0.2 mm/s, and the lag comes on top.
    let job = "FEDRAT/12,MMPM\nRAPID\nGOTO/0,0\nGOTO/1,0\n";
    let refused = landings("job.apt", job, &PostOptions::default());
    assert!(matches!(refused, Err(GalvoError::InvalidOption { name: "laser_on_us", .. })));
}

#[test]
fn endings_are_known() {
    for name in ["a.apt", "a.CL", "a.cls", "a.cldata", "a.nc", "a.gcode", "a.ngc", "a.tap", "a.csv"]
    {
        assert!(JobReader::of_name(name, &b""[..]).is_ok(), "{name}");
    }
    let message = JobReader::of_name("a.txt", &b""[..]).unwrap_err().to_string();
    assert!(message.contains(".csv"), "{message}");
}

#[test]
fn programs_say_what_is_wrong_and_where() {
    let head = ScanHead::default();
    for (text, line, column, word) in [
        ("G90\n (lasergym mark_us=1 hop=2)\n", 2, 22, "known"),
        ("(lasergym mark_us)\n", 1, 11, "key=value"),
        ("; lasergym mark_us=x\n", 1, 12, "number"),
        ("(lasergym mark_us=-1)\n", 1, 11, "out of range"),
        ("  X1 X2\n", 1, 6, "repeats"),
    ] {
        let message =
            ProgramReader::gcode(text.as_bytes(), &head).next_step().unwrap_err().to_string();
        let place = format!("line {line}, column {column}: ");
        assert!(message.starts_with(&place) && message.contains(word), "{text:?}: {message}");
    }
    for (text, line, column, word) in [
        ("set_mark_speed,1,,\nset_mark_speed,0,,\n", 3, 16, "m/s"),
        ("set_jump_speed,0,,\njump_abs,1,2,\n", 3, 1, "jump_speed_m_s"),
        ("  hop,1,,\n", 2, 1, "known"),
        (" jump_abs,1,x,\n", 2, 13, "number"),
    ] {
        let text = format!("command,first,second,third\n{text}");
        let mut reader = ProgramReader::rtc_list(text.as_bytes(), &head);
        let error = loop {
            match reader.next_step() {
                Ok(step) => assert!(step.is_some(), "{text:?} is accepted"),
                Err(error) => break error.to_string(),
            }
        };
        let place = format!("line {line}, column {column}: ");
        assert!(error.starts_with(&place) && error.contains(word), "{text:?}: {error}");
    }
}
