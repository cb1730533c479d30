"""Which kinds of configuration files does topdress know?"""

from __future__ import annotations

from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.product import Product
from topdress.control.field.job import Job
from topdress.control.machine.machine import Machine
from topdress.control.machine.terms import convert_old_tables
from topdress.drivers.cab_config import CabConfig
from topdress.drivers.files.config import ConfigKind, ConfigKinds
from topdress.drivers.files.imports.mapping import IMPORT_KIND
from topdress.drivers.files.settings import SETTINGS_KIND
from topdress.drivers.files.user_themes import THEME_KIND

# Formats are contracts, because every file names its own.
MACHINE_KIND = ConfigKind("topdress-machine/1", "machines", Machine, convert_old_tables)
CROP_KIND = ConfigKind("topdress-crop/1", "crops", Crop)
PRODUCT_KIND = ConfigKind("topdress-product/1", "products", Product)
JOB_KIND = ConfigKind("topdress-job/1", "jobs", Job)
CAB_KIND = ConfigKind("topdress-cab/1", "cabs", CabConfig)

# Kinds by the format that a file names.
CONFIG_KINDS: ConfigKinds = {
    kind.format: kind
    for kind in (
        MACHINE_KIND,
        CROP_KIND,
        PRODUCT_KIND,
        JOB_KIND,
        CAB_KIND,
        SETTINGS_KIND,
        THEME_KIND,
        IMPORT_KIND,
    )
}
