//! The robot's program in the KUKA Robot Language: a source file and its data list.

use std::fmt::Write as _;

use crate::{Pose, RobotMove, RobotProgram};

/// Longest name of a KRL module.
const MAX_NAME: usize = 24;

/// Outputs that the program uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KrlOptions {
    /// Number of the output that starts the scanner.
    pub start_output: u16,
    /// First of the 16 outputs that hold the number of the scanner's list.
    pub list_output: u16,
}

impl Default for KrlOptions {
    fn default() -> Self {
        Self { start_output: 1, list_output: 17 }
    }
}

/// A KRL module.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KrlModule {
    /// Its name, which is that of both files.
    pub name: String,
    /// The source file, `.src`.
    pub src: String,
    /// The data list, `.dat`.
    pub dat: String,
}

/// Writes `program` as a KRL module named after the task. The tool's centre point is the centre of
/// the scanner's working field.
#[must_use]
pub fn write_krl(task_name: &str, program: &RobotProgram, options: &KrlOptions) -> KrlModule {
    let name = module_name(task_name);
    let mut src = format!(
        "&ACCESS RVO\n&REL 1\nDEF {name}( )\n\
         ; Robot program of a remote laser task. TCP: centre of the scanner's working field.\n\
         ; $OUT[{start}] starts the list of the scanner whose number SCANNER_LIST holds.\n\
         SIGNAL SCANNER_LIST $OUT[{first}] TO $OUT[{last}]\n\
         BAS(#INITMOV,0)\n$OUT[{start}]=FALSE\n$ADVANCE=1\n",
        start = options.start_output,
        first = options.list_output,
        last = options.list_output + 15,
    );
    let mut dat = format!("&ACCESS RVO\n&REL 1\nDEFDAT {name}\n");
    let mut places = 0;
    let mut place = |dat: &mut String, pose: &Pose| {
        places += 1;
        let [x, y, z] = pose.place_mm;
        let [a, b, c] = pose.abc_deg;
        let near = |value: f64| (value * 1e4).round() / 1e4 + 0.0;
        // Writing to a string cannot fail.
        let _ = writeln!(
            dat,
            "DECL FRAME P{places}={{X {:.4},Y {:.4},Z {:.4},A {:.4},B {:.4},C {:.4}}}",
            near(x),
            near(y),
            near(z),
            near(a),
            near(b),
            near(c)
        );
        places
    };
    let mut here = Pose::default();
    for one in &program.moves {
        let _ = match *one {
            RobotMove::Ptp { to, .. } => {
                here = to;
                writeln!(src, "PTP P{}", place(&mut dat, &to))
            }
            RobotMove::Wait { time_s } => writeln!(src, "WAIT SEC {time_s:.3}"),
            RobotMove::Line { to, speed_mm_s, acceleration_mm_s2, trigger_mm, list } => {
                let length_mm = crate::plane::distance_mm(here.place_mm, to.place_mm);
                here = to;
                let point = place(&mut dat, &to);
                writeln!(
                    src,
                    "SCANNER_LIST={list}\n$VEL.CP={:.7}\n$ACC.CP={:.7}\n\
                     TRIGGER WHEN PATH={:.4} DELAY=0 DO $OUT[{start}]=TRUE\n\
                     LIN P{point}\n$OUT[{start}]=FALSE",
                    speed_mm_s * 1e-3,
                    acceleration_mm_s2 * 1e-3,
                    trigger_mm - length_mm,
                    start = options.start_output,
                )
            }
        };
    }
    src.push_str("END\n");
    dat.push_str("ENDDAT\n");
    KrlModule { name, src, dat }
}

/// `task_name` as KRL allows: letters, digits and underscores, not beginning with a digit.
fn module_name(task_name: &str) -> String {
    let allowed = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_uppercase() } else { '_' };
    let mut name: String = task_name.chars().map(allowed).collect();
    if !name.starts_with(|c: char| c.is_ascii_alphabetic()) {
        name.insert_str(0, "R_");
    }
    name.truncate(MAX_NAME);
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_modules() {
        assert_eq!(module_name("heat exchanger"), "HEAT_EXCHANGER");
        assert_eq!(module_name("8 holes"), "R_8_HOLES");
        assert_eq!(module_name(""), "R_");
        assert_eq!(module_name(&"ä".repeat(40)).len(), MAX_NAME);
    }

    #[test]
    fn the_trigger_counts_back_from_the_end() {
        let at = |x: f64| Pose { place_mm: [x, 0.0, 0.0], ..Pose::default() };
        let moves = vec![
            RobotMove::Ptp { to: at(10.0), speed_mm_s: 1000.0, acceleration_mm_s2: 2000.0 },
            RobotMove::Line {
                to: at(110.0),
                speed_mm_s: 200.0,
                acceleration_mm_s2: 2000.0,
                trigger_mm: 10.0,
                list: 3,
            },
        ];
        let module = write_krl("plate", &RobotProgram { moves }, &KrlOptions::default());
        for words in ["DEF PLATE( )", "SCANNER_LIST=3", "PATH=-90.0000 DELAY=0", "$VEL.CP=0.2"] {
            assert!(module.src.contains(words), "{words}: {}", module.src);
        }
        assert!(module.dat.contains("P2={X 110.0000,Y 0.0000"), "{}", module.dat);
    }
}
