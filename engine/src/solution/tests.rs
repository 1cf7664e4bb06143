//! Files of CalculiX that end early or are damaged.

use super::dat::{Printed, number};
use super::*;

const DAT: &str = "
 displacements (vx,vy,vz) for set FACES and time  0.5000000E+00

         1  9.000000E+00  0.000000E+00  0.000000E+00

 displacements (vx,vy,vz) for set FACES and time  0.1000000E+01

         1  1.000000E-05  2.000000E-05 -3.000000E-05
         2  0.100000-101  0.000000E+00  0.000000E+00

 displacements (vx,vy,vz) for set OTHER and time  0.1000000E+01

         7  1.000000E-05  2.000000E-05 -3.000000E-05

 forces (fx,fy,fz) for set FACES and time  0.1000000E+01

         1 -2.053954E-02 -1.698645E-02 -6.134317E-01

 total force (fx,fy,fz) for set FACES and time  0.1000000E+01

        4.475587E-15 -8.442552E-14 -6.185052E-13
";

#[test]
fn the_last_block_of_the_set_counts() {
    let printed = Printed::read(DAT, "faces").unwrap();
    assert_eq!(printed.displacements_mm.len(), 2);
    assert_eq!(printed.displacements_mm[&1], Vector3::new(1e-5, 2e-5, -3e-5));
    assert_eq!(printed.displacements_mm[&2].x, 0.1e-101);
    assert_eq!(printed.forces_n[&1].z, -0.613_431_7);
    assert_eq!(printed.time, 1.0);
}

#[test]
fn damaged_prints_name_the_line() {
    let cut = &DAT[..DAT.find(" forces").unwrap()];
    let missing = Printed::read(cut, "faces").unwrap_err().to_string();
    assert!(missing.starts_with("model.dat has no forces of the set faces"), "{missing}");
    let damaged = DAT.replace("-2.053954E-02 -1.698645E-02", "NaN -1.698645E-02");
    let unreadable = Printed::read(&damaged, "faces").unwrap_err().to_string();
    assert!(
        unreadable.starts_with("model.dat, line 17 is not what CalculiX writes: \"1 NaN"),
        "{unreadable}"
    );
    assert_eq!(number("1.5-300"), Some(1.5e-300));
    assert_eq!(number("-"), None);
    assert_eq!(number("inf"), None);
}

const FRD: &str = "    1C
    2C                             2                                     1
 -1         1 0.00000E+00 0.00000E+00 0.00000E+00
 -3
  100CL  101 1.000000000           2                     0    1           1
 -4  DISP        4    1
 -5  D1          1    2    1    0
 -5  D2          1    2    2    0
 -5  D3          1    2    3    0
 -5  ALL         1    2    0    0    1ALL
 -1         1 1.00000E+00-2.00000E+00 3.00000E+00
 -1         2-1.00000E+00 2.00000E+00-3.00000E-10
 -3
 9999
";

#[test]
fn fields_are_read_by_columns() {
    let fields = frd::read(FRD).unwrap();
    assert_eq!(fields.len(), 1);
    assert_eq!((fields[0].name.as_str(), fields[0].components), ("DISP", 3));
    assert_eq!(fields[0].rows[1], (2, vec![-1.0, 2.0, -3e-10]));
    let cut = &FRD[..FRD.rfind(" -3").unwrap()];
    assert!(frd::read(cut).unwrap_err().to_string().contains("CalculiX ended before its end"));
    let damaged = FRD.replace("2.00000E+00-3.00000E-10", "2.00000E+00-3.0000");
    assert!(frd::read(&damaged).is_ok());
    let damaged = FRD.replace("-3.00000E-10", "");
    assert!(frd::read(&damaged).unwrap_err().to_string().starts_with("model.frd, line 13 is not"));
}

#[test]
fn a_mesh_of_other_elements_or_numbers_is_refused() {
    for (text, says) in [
        ("*NODE\n1,0,0,0\n*ELEMENT, TYPE=B31, ELSET=a\n1,1,1\n", "mesh.inp, line 3"),
        ("*NODE\n2,0,0,0\n", "mesh.inp, line 2"),
        ("*NODE\n1,0,0\n", "mesh.inp, line 2"),
        ("*NODE\n1,0,0,0\n*ELEMENT, TYPE=C3D4, ELSET=a\n1,1,1,1,2\n", "mesh.inp, line 4"),
        ("** nothing\n", "mesh.inp has no elements"),
    ] {
        let refused = deck_mesh::read(text).unwrap_err().to_string();
        assert!(refused.starts_with(says), "{refused}");
    }
    let other = Results::of_deck("{}", "").unwrap_err().to_string();
    assert!(other.starts_with("deck.json is not that of a deck"), "{other}");
}
