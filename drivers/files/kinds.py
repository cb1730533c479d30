"""The kinds of configuration files that topdress knows."""

from __future__ import annotations

from control.agronomy.crop import Crop
from control.agronomy.product import Product
from control.field.job import Job
from control.machine.machine import Machine
from control.machine.terms import without_old_tables
from drivers.cab_config import CabConfig
from drivers.files.config import Kind, Kinds
from drivers.files.imports.mapping import IMPORT
from drivers.files.settings import SETTINGS
from drivers.files.settings_theme import THEME

MACHINE = Kind("topdress-machine/1", "machines", Machine, without_old_tables)
CROP = Kind("topdress-crop/1", "crops", Crop)
PRODUCT = Kind("topdress-product/1", "products", Product)
JOB = Kind("topdress-job/1", "jobs", Job)
CAB = Kind("topdress-cab/1", "cabs", CabConfig)

KINDS: Kinds = {
    kind.format: kind for kind in (MACHINE, CROP, PRODUCT, JOB, CAB, SETTINGS, THEME, IMPORT)
}
