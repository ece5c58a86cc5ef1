//! Object dictionaries as makers' files have them.

use drives::canopen::Object;
use drives::canopen::eds::ObjectDictionary;
use drives::cia402::{Drive, Kind, Mode, Reported, Side};

/// In the manner of makers' files: CRLF, both kinds of numbers, sub-indices in hexadecimal, an array in
/// short, and identifiers that depend on the node.
const EDS: &str = "[FileInfo]\r\nFileName=drive.eds\r\n; a comment\r\n\r\n[DeviceInfo]\r\nVendorName=Somebody\r\nVendorNumber=0x5A\r\nProductNumber=12\r\n\r\n[1000]\r\nParameterName=Device type\r\nObjectType=0x7\r\nDataType=0x0007\r\nAccessType=ro\r\nDefaultValue=0x00020192\r\nPDOMapping=0\r\n\r\n[1400]\r\nParameterName=RPDO1\r\nSubNumber=3\r\nObjectType=0x9\r\n\r\n[1400sub1]\r\nParameterName=COB-ID\r\nDataType=7\r\nAccessType=rw\r\nDefaultValue=$NODEID+0x200\r\n\r\n[1401sub1]\r\nParameterName=COB-ID\r\nDataType=7\r\nAccessType=rw\r\nDefaultValue=0x300+$NODEID\r\n\r\n[1800sub1]\r\nParameterName=COB-ID\r\nDataType=7\r\nAccessType=rw\r\n\r\n[1003]\r\nParameterName=Errors\r\nObjectType=0x8\r\nDataType=0x0007\r\nAccessType=ro\r\nCompactSubObj=10\r\n\r\n[6040]\r\nParameterName=Controlword\r\nDataType=0x0006\r\nAccessType=rww\r\nPDOMapping=1\r\n\r\n[6041]\r\nParameterName=Statusword\r\nDataType=0x0006\r\nAccessType=ro\r\nPDOMapping=1\r\n\r\n[6064]\r\nParameterName=Position actual value\r\nDataType=0x0004\r\nAccessType=ro\r\nPDOMapping=1\r\n\r\n[6071]\r\nParameterName=Target torque\r\nDataType=0x0003\r\nAccessType=rw\r\nPDOMapping=0\r\n\r\n[6078]\r\nParameterName=Current actual value\r\nDataType=0x0003\r\nAccessType=ro\r\nPDOMapping=1\r\n\r\n[607A]\r\nParameterName=Target position\r\nDataType=0x0004\r\nAccessType=rw\r\nPDOMapping=1\r\n\r\n[6502]\r\nParameterName=Modes\r\nDataType=0x0007\r\nAccessType=ro\r\nDefaultValue=0x00000080\r\n";

fn dictionary() -> ObjectDictionary {
    ObjectDictionary::parse(EDS, "drive.eds").unwrap_or_else(|problems| panic!("{problems}"))
}

fn kind(mode: Mode) -> Kind {
    Kind {
        mode,
        side: Side::Motor,
        other_angle: None,
        velocity_unit: None,
        rated_current: 5.0,
        current_per_torque: 5.0,
        rated_torque: 100.0,
        reported: Reported::default(),
        heartbeat_ms: 100,
        vendor: None,
        product: None,
        sdo: Vec::new(),
    }
}

fn problems(kind: &Kind) -> String {
    let drive = Drive {
        kind,
        name: "knee",
        bus: 0,
        node: 3,
        period: 1e-3,
        position_count: ("count", 1.0),
        asked: None,
    };
    match drive.check(&dictionary()) {
        Ok(()) => String::new(),
        Err(problems) => problems.to_string(),
    }
}

#[test]
fn entries_are_read_with_type_access_and_value() {
    let dictionary = dictionary();
    let entry = |index, sub| dictionary.entry(Object::new(index, sub));
    assert_eq!(dictionary.identity.vendor, Some(0x5A));
    assert_eq!(dictionary.identity.product, Some(12));
    assert!(
        entry(0x1400, 0).is_none(),
        "a record has no type of its own"
    );
    let position = entry(0x6064, 0).expect("an entry");
    assert_eq!((position.bits, position.signed), (Some(32), true));
    assert!(position.mappable && position.readable && !position.writable);
    assert_eq!(EDS.lines().nth(position.line - 1), Some("[6064]"));
    assert!(entry(0x1003, 10).is_some() && entry(0x1003, 11).is_none());
    let value = |index, sub| dictionary.value(Object::new(index, sub), 5);
    assert_eq!(value(0x1000, 0), Some(0x0002_0192));
    assert_eq!(
        (value(0x1400, 1), value(0x1401, 1)),
        (Some(0x205), Some(0x305))
    );
    assert_eq!(value(0x6064, 0), None);
}

#[test]
fn a_drive_that_fits_has_no_problems_and_one_that_does_not_is_named() {
    assert_eq!(problems(&kind(Mode::Position)), "");
    let torque = problems(&kind(Mode::Torque));
    for part in [
        "drive.eds:",
        "6071:00 (Target torque) cannot be mapped",
        "object 6502:00: the drive has no mode 10",
    ] {
        assert!(torque.contains(part), "{part:?} is not in {torque}");
    }
    let mut other = kind(Mode::Position);
    other.other_angle = Some(Object::new(0x2240, 0));
    other.sdo = vec![
        (Object::new(0x6064, 0), vec![0; 4]),
        (Object::new(0x607A, 0), vec![0; 2]),
    ];
    let other = problems(&other);
    for part in [
        "no object 2240:00",
        "no PDO parameter 1801:01",
        "6064:00 cannot be written",
        "607A:00 does not have 16 bits",
    ] {
        assert!(other.contains(part), "{part:?} is not in {other}");
    }
}

#[test]
fn what_is_no_such_file_is_refused() {
    for text in ["", "VERSION \"\"", "[FileInfo]\nFileName=a"] {
        let problems = ObjectDictionary::parse(text, "a.eds")
            .expect_err("refused")
            .to_string();
        assert!(problems.contains("no object is described"), "{problems}");
    }
    let problems = ObjectDictionary::parse("[6041]\nDataType=word", "a.eds").expect_err("refused");
    assert!(problems.to_string().starts_with("a.eds:1: "), "{problems}");
}
