"""Types of the values on typed streams: fields with kinds, bounds and steps.

The problem: on the channel a field name is eight bytes, and a useless digit is half a second of
airtime. So a type is defined once at each end, and only the values of the fields cross, in the
order of the type. This only works when both ends have the *same* definition; `TypeSpec.canonical`
is its text, which goes into the digest that the ends compare.

The idea: a `FieldSpec` says what a value is and, unlike an interface definition language, which
values are allowed: a range that both ends check, and a step below which differences do not matter.
The step makes a value small: a latitude to 1e-6 degrees is an integer of at most 28 bits, and a
number in 0.1 m steps up to 1000 m fits two bytes.

One module each:

- `fields`: `FieldSpec` and the scalar kinds;
- `quantiser`: `Quantiser`, numbers with a step as integers and back; `lattice`: `Lattice`, every
  bounded scalar as the integers from 0;
- `ends`: `Ends`, the ends of a float's range, also in single precision;
- `outside`: `OutsideValues`, the treatment of values outside of their bounds; `trimming`: of those
  that are too long, or that the type does not know;
- `scalars`, `validation`: checks of an application's values, compiled once;
- `spec`: `TypeSpec`; `table`: `TypeTable`, nested types by name;
- `annotations`: `Bounds`; `structs`: types from annotated Python classes, and values into them;
  `generated`: classes from types;
- `agreement`: whether a configured type and a Python class are the same type.

Invariants. A `FieldSpec` or `TypeSpec` that exists is consistent: a contradiction is a
`ConfigError` at construction. Its message starts with the key (``range: [90, -90]; allowed: low <
high``), so that the reader of the file can prepend the path. Nesting is at most `MAX_DEPTH` deep,
and a nested type has at least one field: every leaf costs at least a byte on the wire, so a payload
bounds the work of its decoder.
"""

from zacoustic.core.values.types.agreement import check_agreement
from zacoustic.core.values.types.annotations import Bounds
from zacoustic.core.values.types.ends import Ends
from zacoustic.core.values.types.fields import FLOAT_TYPES, INTEGER_LIMITS, SCALAR_TYPES, FieldSpec
from zacoustic.core.values.types.generated import struct_from_type
from zacoustic.core.values.types.lattice import Lattice
from zacoustic.core.values.types.outside import OutsideValues
from zacoustic.core.values.types.quantiser import Quantiser
from zacoustic.core.values.types.spec import MAX_DEPTH, TypeSpec
from zacoustic.core.values.types.structs import struct_builder, type_from_struct
from zacoustic.core.values.types.table import TypeTable

__all__ = [
    "FLOAT_TYPES",
    "INTEGER_LIMITS",
    "MAX_DEPTH",
    "SCALAR_TYPES",
    "Bounds",
    "Ends",
    "FieldSpec",
    "Lattice",
    "OutsideValues",
    "Quantiser",
    "TypeSpec",
    "TypeTable",
    "check_agreement",
    "struct_builder",
    "struct_from_type",
    "type_from_struct",
]
