# `make demo`, `make test` and `make check` build .venv if it is missing or out of date.
# `make install` builds a separate environment for the service, at PREFIX.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.complete

# Targets of `make install`; DESTDIR is prepended to all paths, for packages and images.
PREFIX  ?= /opt/contactd
DESTDIR ?=
# Folder of your robot, copied to /etc/contactd on the first installation; default: an example.
ROBOT   ?=
# Root of files outside PREFIX: /usr in a Debian package.
LOCAL   ?= /usr/local
LIB     := $(DESTDIR)$(LOCAL)/lib
UNITS   := $(LIB)/systemd/system
DEVICE  := sys-subsystem-net-devices-can0.device.d
SHARE   := $(DESTDIR)$(PREFIX)/share/contactd
# Manual pages and completions, generated into $(PREFIX)/share (programs/manual.py) and linked.
PAGES   := $(foreach p,contactd contactctl contactd-web contactd-zenoh,man/man1/$(p).1 bash-completion/completions/$(p) \
  zsh/site-functions/_$(p) fish/vendor_completions.d/$(p).fish)
# Debian's zsh expects those of packages in another folder.
LINKED  := $(if $(filter /usr,$(LOCAL)),sed 's|zsh/site-functions|zsh/vendor-completions|',cat)
# Examples to install; other folders in configs/ are yours.
EXAMPLES := $(addprefix configs/,beam_arm desk_arm openarm_left romeo_left_arm single_joint)
# Prefix of commands that create files: they must be readable by all, whatever root's umask is.
PUBLIC  := umask 022;
# Not empty if the service is installed into this machine's running systemd.
HERE    := $(if $(DESTDIR),,$(wildcard /run/systemd/system))

.PHONY: help compiled demo web built picture test test-slow test-all fuzz check units soak system dist deb release install install-env install-files install-service uninstall verify reference lerobot uplot lock clean
.DEFAULT_GOAL := help

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-13s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

define check-python
@$(PYTHON) -c 'import sys; sys.exit("contactd needs Python 3.11 or newer, not " + sys.version.split()[0] + \
  " (choose another: make PYTHON=python3.12 ...)" if sys.version_info < (3, 11) else 0)'
@$(PYTHON) -c 'import ensurepip' || { echo "this Python has no venv: apt install python3-venv"; exit 1; }
endef

# PREFIX is replaced and removed as a whole, so it must be an environment of contactd, not e.g. /usr/local.
define refuse-strange-prefix
@test ! -e $(DESTDIR)$(PREFIX) || test -e $(DESTDIR)$(PREFIX)/bin/contactd -a -e $(DESTDIR)$(PREFIX)/pyvenv.cfg || \
  { echo "$(DESTDIR)$(PREFIX) exists and is not an environment of contactd: choose another PREFIX"; exit 1; }
endef

define refuse-strange-robot
@test -z "$(ROBOT)" || test -f "$(ROBOT)/config.yaml" || \
  { echo "ROBOT=$(ROBOT): config.yaml is missing; ROBOT must be the folder of one robot"; exit 1; }
endef

LOCKS := requirements.lock requirements-web.lock requirements-ros.lock requirements-dev.lock
# Condenses pip's output to one line of progress; fails if pip does.
COUNT := '/^Collecting/ {printf "\r%d packages", ++n} /^Installing/ {printf ", installing them"} \
  {fflush()} /^failed$$/ {bad = 1} END {print ""; exit bad}'

$(STAMP): $(LOCKS) pyproject.toml
	$(check-python)
	$(PYTHON) -m venv --clear $(VENV)
	@echo "installing the packages of the lock files (a few minutes the first time)"
	@{ $(BIN)/pip install --disable-pip-version-check --no-deps $(LOCKS:%=-r %) || echo failed; } | awk $(COUNT)
	@command -v gcc >/dev/null || command -v cc >/dev/null || $(BIN)/pip install --quiet --disable-pip-version-check ziglang==0.17.1
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

# Modules are out of date by the digests of their sources, not their times. If compilation fails, the
# reason is printed and everything runs as plain Python.
compiled: $(STAMP)  ## build the compiled modules whose sources changed
	@$(BIN)/python hatch_build.py || true

# WEB=1: also on a page in your browser. ARM=openarm_left: Damiao motors, with their guardian.
demo: $(STAMP) compiled  ## the paper's third experiment on a simulated arm, about 30 s
	@trap : INT; $(BIN)/contactd demo $(if $(ARM),--arm $(ARM)) $(if $(WEB),--web) || test $$? -eq 130 # Ctrl-C is no error

# Tests that fail in parallel are repeated alone, and must pass then; both runs are in the output
# (docs/decisions/0022-tests.md).
define tests
@$(BIN)/python -m pytest -q -n auto --dist loadfile -m "$(1)" || { test $$? -eq 1 && \
  echo "FAILED IN PARALLEL, as above; repeated alone:" && \
  $(BIN)/python -m pytest -q --last-failed --last-failed-no-failures none -m "$(1)"; }
endef

test: $(STAMP) compiled  ## the fast tests, about four minutes
	$(call tests,not slow)

test-slow: $(STAMP) compiled  ## the tests listed in tests/slow.txt, a quarter of an hour
	$(call tests,slow)

test-all: test test-slow  ## all tests

# New examples for every property in tests/; a failure prints the example and how to reproduce it.
fuzz: SEED ?= $(shell date +%s)
fuzz: $(STAMP) compiled  ## thousands of new examples for the property-based tests; SEED=n repeats a run
	@echo "seed $(SEED): repeat with make fuzz SEED=$(SEED)"
	$(BIN)/python -m pytest -q -n auto --dist loadfile -m hypothesis --hypothesis-profile=fuzz \
	  --hypothesis-seed=$(SEED)

web: page/node_modules/.package-lock.json  ## bundle the page's sources (page/) into programs/web/built; needs node and npm
	cd page && node build.mjs

page/node_modules/.package-lock.json: page/package.json page/package-lock.json
	cd page && npm ci --no-audit --no-fund --ignore-scripts
	@touch $@

picture: $(STAMP) compiled  ## docs/page/push.png: the page in chromium, while the demo's hand pushes
	$(BIN)/python docs/page/picture.py

house: $(STAMP)  ## sizes, words and other limits of the sources, with their goals
	@$(BIN)/python tests/house.py

check: $(STAMP) units built  ## ruff, mypy (strict), import layers, limits, systemd units, the page's bundle
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	@$(MAKE) -s house

# The bundled page is committed, so that node is not needed to run contactd.
built:
	@if ! command -v npm >/dev/null; then \
	  echo "built: programs/web/built not checked against page/: npm is not installed"; exit 0; fi; \
	set -e; $(MAKE) -s page/node_modules/.package-lock.json; cd page; node build.mjs --check

# Units as installed, but with this environment's contactd. systemd-analyze exits 0 on unknown keys, so
# its output must be empty, too.
units: STAGE := $(abspath build/units)
units: SERVICE := $(STAGE)/usr/local/lib/systemd/system/contactd.service
units: BESIDE := contactd-guardian contactd-web contactd-zenoh
units: $(STAMP)
	@if ! command -v systemd-analyze >/dev/null; then \
	  echo "units: not checked: systemd-analyze is not installed (apt install systemd)"; exit 0; fi; \
	set -e; rm -rf $(STAGE); $(MAKE) -s install-files DESTDIR=$(STAGE) >/dev/null; \
	sed -i 's|=/opt/contactd|=$(abspath $(VENV))|' $(SERVICE); \
	for name in $(BESIDE); do \
	  unit=$(dir $(SERVICE))$$name.service; \
	  sed -i 's|=/opt/contactd|=$(abspath $(VENV))|' $$unit; \
	  said=$$(systemd-analyze verify --man=no $$unit 2>&1) && [ -z "$$said" ] || { echo "$$said"; exit 1; }; \
	  systemd-analyze security --no-pager --offline=true --threshold=20 $$unit >$(STAGE)/security || \
	    { cat $(STAGE)/security; exit 1; }; \
	  echo "units: verified $$name: $$(tail -1 $(STAGE)/security)"; \
	done; \
	for conf in systemd/contactd.service.d/bus.conf systemd/examples/bus-*.conf systemd/examples/cpu.conf; do \
	  cp $$conf $(SERVICE).d/$$(basename $$conf | sed 's/bus-.*/bus.conf/'); \
	  said=$$(systemd-analyze verify --man=no $(SERVICE) 2>&1) && [ -z "$$said" ] || \
	    { echo "systemd-analyze verify, with $$conf:"; echo "$$said"; exit 1; }; \
	  systemd-analyze security --no-pager --offline=true --threshold=20 $(SERVICE) >$(STAGE)/security || \
	    { cat $(STAGE)/security; exit 1; }; \
	  echo "units: verified with $$conf: $$(tail -1 $(STAGE)/security)"; \
	done

# JOBS: number of processes for the simulated hours.
soak: MINUTES ?= 20
soak: HOURS ?= 3
soak: JOBS ?= 1
soak: $(STAMP) compiled  ## MINUTES=20 in real time and HOURS=3 simulated: what breaks, and what grows?
	$(BIN)/python -m bench.soak --minutes $(MINUTES) --hours $(HOURS) --jobs $(JOBS)

system: $(STAMP)  ## the installed service under systemd on a virtual CAN bus (root; a test machine)
	$(BIN)/python -m pytest -q -rs tests/system --system

dist: $(STAMP) compiled  ## wheel and source archive, into dist
	$(BIN)/python -m hatchling build -c
	@ls -sh --block-size=kB dist

# With Debian's own Python, on which the package depends. The package is not signed.
deb: ROOT := $(abspath build/deb)
deb: $(STAMP) compiled  ## a Debian package of environment, service, manual and completions, into dist
	rm -rf $(ROOT) && mkdir -p $(ROOT) dist
	$(MAKE) -s install-env install-service DESTDIR=$(ROOT) LOCAL=/usr PYTHON=$(shell readlink -f /usr/bin/python3)
	$(BIN)/python package/deb.py $(ROOT) dist

release: $(STAMP) compiled  ## check everything required before tagging RELEASE=0.2.0; tags nothing
	$(BIN)/python package/release.py $(RELEASE)

install: install-env install-files  ## into PREFIX=/opt/contactd, as a service, with ROBOT=configs/my_arm (root; honours DESTDIR)
ifneq ($(HERE),)
	systemd-sysusers $(LOCAL)/lib/sysusers.d/contactd.conf
	systemctl daemon-reload
	@sed 's|/opt/contactd|$(PREFIX)|' systemd/next-steps
	@$(PREFIX)/bin/python -P -m common.compiled
endif

# Built beside the old environment, which it replaces at the end. No file in it may contain $(DESTDIR).
install-env: NEW := $(DESTDIR)$(PREFIX).new
install-env:
	$(refuse-strange-prefix)
	$(refuse-strange-robot)
	$(check-python)
	@$(PYTHON) -c 'import sys; p = sys.base_prefix; sys.exit(p.startswith(("/home/", "/root/")) and \
	  f"{p} is in a home folder, which the service cannot see: make install PYTHON=/usr/bin/python3")'
	rm -rf $(NEW)
	$(PUBLIC) $(PYTHON) -m venv $(NEW)
	$(PUBLIC) $(NEW)/bin/pip install --quiet --disable-pip-version-check --no-compile --no-deps -r requirements.lock -r requirements-web.lock -r requirements-ros.lock .
	@$(NEW)/bin/python -P -m common.compiled
	$(PUBLIC) $(NEW)/bin/python -P -m programs.manual $(NEW)/share
	$(PYTHON) package/slim.py $(NEW)
	grep -rlIF $(NEW) $(NEW)/bin $(NEW)/pyvenv.cfg | xargs sed -i 's|$(NEW)|$(PREFIX)|g'
	-$(PUBLIC) $(NEW)/bin/python -m compileall -qq -s $(NEW) -p $(PREFIX) $(NEW)/lib
	rm -rf $(DESTDIR)$(PREFIX)
	mv $(NEW) $(DESTDIR)$(PREFIX)

install-service:
	$(refuse-strange-robot)
	$(PUBLIC) install -d $(DESTDIR)$(LOCAL)/bin $(SHARE)/configs
	ln -sf $(PREFIX)/bin/contactd $(PREFIX)/bin/contactctl $(PREFIX)/bin/contactd-web $(PREFIX)/bin/contactd-zenoh $(DESTDIR)$(LOCAL)/bin/
	$(PUBLIC) for page in $(PAGES); do link=$(DESTDIR)$(LOCAL)/share/$$(echo $$page | $(LINKED)) && \
	  install -d $$(dirname $$link) && ln -sf $(PREFIX)/share/$$page $$link || exit 1; done
	cp -R --no-preserve=ownership docs systemd/examples $(SHARE)/
	cp -R --no-preserve=ownership $(EXAMPLES) $(SHARE)/configs/
	find $(SHARE)/configs -name '*.mcap' -delete
	chmod -R a+rX $(SHARE)
	$(PUBLIC) install -d $(UNITS)/contactd.service.d $(UNITS)/$(DEVICE)
	$(PUBLIC) sed 's|/opt/contactd|$(PREFIX)|g' systemd/contactd.service >$(UNITS)/contactd.service
	$(PUBLIC) for name in contactd-guardian contactd-web; do \
	  sed 's|/opt/contactd|$(PREFIX)|g' systemd/$$name.service >$(UNITS)/$$name.service || exit 1; done
	$(PUBLIC) sed 's|/opt/contactd|$(PREFIX)|g' systemd/contactd-zenoh.service >$(UNITS)/contactd-zenoh.service
	install -m 644 systemd/contactd.service.d/bus.conf $(UNITS)/contactd.service.d/
	install -m 644 systemd/$(DEVICE)/contactd.conf $(UNITS)/$(DEVICE)/
	$(PUBLIC) install -D -m 644 systemd/can0.network $(LIB)/systemd/network/can0.network
	$(PUBLIC) install -D -m 644 systemd/contactd.sysusers $(LIB)/sysusers.d/contactd.conf

install-files: install-service
	$(PUBLIC) install -d $(DESTDIR)/etc
	@if [ -e $(DESTDIR)/etc/contactd ]; then \
	  echo "/etc/contactd exists and is kept$(if $(ROBOT),; ROBOT=$(ROBOT) is not copied)"; else \
	  set -ex; cp -RL --no-preserve=ownership $(or $(ROBOT),configs/romeo_left_arm) $(DESTDIR)/etc/contactd; \
	  find $(DESTDIR)/etc/contactd -name '*.mcap' -delete; \
	  $(if $(ROBOT),,rm $(DESTDIR)/etc/contactd/identified.yaml; \
	  sed -i 's|^bus:.*|bus: {interface: socketcan, channel: can0, bitrate: 1000000}|' $(DESTDIR)/etc/contactd/config.yaml;) \
	  chmod -R a+rX $(DESTDIR)/etc/contactd; fi

uninstall:  ## stop and remove the service; configuration and recordings stay (root)
	$(refuse-strange-prefix)
ifneq ($(HERE),)
	-systemctl disable --now contactd-web.service contactd-zenoh.service contactd.service contactd-guardian.service
endif
	rm -rf $(UNITS)/contactd-guardian.service $(UNITS)/contactd-web.service $(UNITS)/contactd-zenoh.service $(UNITS)/contactd.service $(UNITS)/contactd.service.d $(UNITS)/$(DEVICE) $(DESTDIR)$(PREFIX) $(DESTDIR)$(PREFIX).new
	rm -f $(LIB)/systemd/network/can0.network $(LIB)/sysusers.d/contactd.conf
	-rmdir --ignore-fail-on-non-empty $(UNITS) $(LIB)/systemd/network $(LIB)/systemd $(LIB)/sysusers.d
	rm -f $(addprefix $(DESTDIR)$(LOCAL)/bin/,contactd contactctl contactd-web contactd-zenoh) $(addprefix $(DESTDIR)$(LOCAL)/share/,$(PAGES))
ifneq ($(HERE),)
	systemctl daemon-reload
endif
	@echo "kept: /etc/contactd, /var/lib/contactd, users contactd, contactd-web and contactd-zenoh, groups contact and contact-view,"
	@echo "and your own files: drop-ins below /etc/systemd, and below /etc/systemd/network"

verify: $(STAMP)  ## compare our URDF with the public Romeo description (downloads 400 MB)
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps example-robot-data
	$(BIN)/python -m pytest -q -m verify

# Library in the pages of `contactd plot`, from the npm package with its digest.
UPLOT := 1.6.32
UPLOT_SHA512 := 2883159c6ebccefbb95d751b0b82d010f9e1c0ec41b8bc96d401eda66e882935c89a46cb824332fa369b8cb8122cc6ac36e186cd09bf7a9ded3a4c93c6989023
LEROBOT := build/lerobot

$(LEROBOT)/.complete: lerobot_robot_contactd/pyproject.toml
	$(PYTHON) -m venv $(LEROBOT)
	$(LEROBOT)/bin/pip install --quiet 'lerobot==0.4.4' ./contactd_client ./lerobot_robot_contactd
	touch $@

lerobot: $(STAMP) compiled $(LEROBOT)/.complete  ## LeRobot with our plug-in, in a separate environment (8 GB), and its tests
	$(LEROBOT)/bin/pip install --quiet --no-deps --force-reinstall ./contactd_client ./lerobot_robot_contactd
	$(BIN)/python -m pytest -rs tests/programs/recordings/test_lerobot.py

uplot:  ## fetch uPlot (npm) into programs/recordings/uplot
	rm -rf build/uplot && mkdir -p build/uplot
	npm pack --silent --pack-destination build/uplot uplot@$(UPLOT)
	echo "$(UPLOT_SHA512)  build/uplot/uplot-$(UPLOT).tgz" | sha512sum --check --quiet
	tar xzf build/uplot/uplot-$(UPLOT).tgz -C build/uplot
	cp build/uplot/package/LICENSE build/uplot/package/dist/uPlot.iife.min.js build/uplot/package/dist/uPlot.min.css programs/recordings/uplot/
	cd programs/recordings/uplot && sha256sum LICENSE uPlot.iife.min.js uPlot.min.css > SHA256SUMS

reference: $(STAMP)  ## write the reference pages in docs from the code
	$(BIN)/python docs/reference.py

lock:  ## resolve the dependencies again and write the lock files (names and versions)
	rm -rf build/lock && $(PYTHON) -m venv build/lock
	build/lock/bin/pip install --quiet .
	build/lock/bin/pip freeze --exclude contactd > requirements.lock
	build/lock/bin/pip install --quiet ".[web]"
	build/lock/bin/pip freeze --exclude contactd | grep -vxFf requirements.lock > requirements-web.lock
	build/lock/bin/pip install --quiet ".[ros,web]"
	build/lock/bin/pip freeze --exclude contactd | grep -vxFf requirements.lock -f requirements-web.lock > requirements-ros.lock
	build/lock/bin/pip install --quiet ".[bench,cluster,dev,foxglove,logs,ros,web]" hatchling
	build/lock/bin/pip freeze --exclude contactd | grep -vxFf requirements.lock -f requirements-web.lock -f requirements-ros.lock > requirements-dev.lock

clean:  ## remove the environment and everything that was built
	-$(BIN)/python hatch_build.py --clean
	rm -rf $(VENV) build dist bench/out .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
