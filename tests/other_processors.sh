#!/usr/bin/env bash
# The tests with the arithmetic of other processors: `tests/other_processors.sh`, or with the names of some of its runs.
# Kernels, NumPy and BLAS choose their instructions by the machine, so the last bits of sums differ between machines.
# What fails here only is a fault in the code, or an expectation that is narrower than rounding allows.
set -uo pipefail
cd "$(dirname "$0")/.."

# NumPy's own names for the instructions that it can leave out; they changed with its releases.
dispatched() {
  python -c "
import re
from numpy._core._multiarray_umath import __cpu_dispatch__ as names
print(' '.join(name for name in names if re.search('$1', name)))"
}

declare -A settings=(
  [kernels]="NUMBA_CPU_NAME=generic"
  [without-avx512]="NPY_DISABLE_CPU_FEATURES=$(dispatched 'AVX512|X86_V4')"
  [without-avx2]="NPY_DISABLE_CPU_FEATURES=$(dispatched 'AVX|FMA|X86_V[34]')"
  [blas-haswell]="OPENBLAS_CORETYPE=Haswell"
  [blas-nehalem]="OPENBLAS_CORETYPE=Nehalem"
)
order=(kernels without-avx512 without-avx2 blas-haswell blas-nehalem)

status=0
for name in "${@:-${order[@]}}"; do
  if [ -z "${settings[$name]:-}" ]; then
    echo "no run is called $name; there are ${order[*]}" >&2
    exit 2
  fi
  echo "== $name: ${settings[$name]}"
  env "${settings[$name]}" pytest -n 2 || status=1
done
exit "$status"
