"""Which kinds of configuration files does topdress know?"""

from __future__ import annotations

from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.product import Product
from topdress.control.field.job import Job
from topdress.control.machine.machine import Machine
from topdress.control.machine.terms import convert_old_tables
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.files.config import Kind, Kinds
from topdress.drivers.files.imports.mapping import IMPORT
from topdress.drivers.files.settings import SETTINGS
from topdress.drivers.files.settings_theme import THEME

# Formats are contracts, because every file names its own.
MACHINE = Kind("topdress-machine/1", "machines", Machine, convert_old_tables)
CROP = Kind("topdress-crop/1", "crops", Crop)
PRODUCT = Kind("topdress-product/1", "products", Product)
JOB = Kind("topdress-job/1", "jobs", Job)
CAB = Kind("topdress-cab/1", "cabs", CabConfig)

# Kinds by the format that a file names.
KINDS: Kinds = {
    kind.format: kind for kind in (MACHINE, CROP, PRODUCT, JOB, CAB, SETTINGS, THEME, IMPORT)
}
