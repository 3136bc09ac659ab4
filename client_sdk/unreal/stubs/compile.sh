#!/bin/sh
# Compile the modules Terraport and TerraportSample against the stubs as 5.2, 5.4 and 5.8, in the C++ that each of those engines
# takes where nothing is said (17, and 20 from 5.3 on); and the core as both. Names and types alone.
# `--each`: every file of the modules alone, which finds what one forgets to include, and takes ten times as long.
set -e
cd "$(dirname "$0")/.."
files="Source/Terraport/Private/*.cpp Source/TerraportSample/Private/*.cpp"
compile() { # STANDARD FILE OPTION ...
	standard="$1"
	shift
	"${CXX:-g++}" -std="c++$standard" -fsyntax-only -fno-exceptions -fno-rtti -Wall -Wextra -Wshadow -Werror -I. \
		-ISource/TerraportCore/Public -x c++ "$@"
}
merged() { # FILE ...: GCC takes an included .cpp for a header, whose classes had better not hold what is anonymous.
	printf '#include "%s"\n' "$@"
}
for engine in 2:17 4:20 8:20; do
	options="-DTERRAPORTCORE_API=DLLIMPORT -DSTUB_ENGINE_MINOR=${engine%:*} -Istubs -Istubs/generated
		-ISource/Terraport/Public -ISource/Terraport/Private -ISource/TerraportSample/Public"
	if [ "$1" = --each ]; then
		for file in $files; do compile "${engine#*:}" "$file" $options; done
	else
		merged $files | compile "${engine#*:}" - -Wno-subobject-linkage $options
	fi
	echo "5.${engine%:*}: both modules, C++${engine#*:}"
done
core=$(ls Source/TerraportCore/Private/*.cpp | grep -v Module)
for standard in 17 20; do
	merged $core | compile $standard - -Wno-subobject-linkage -Wpedantic -ISource/TerraportCore/Private
	echo "core: C++$standard"
done
