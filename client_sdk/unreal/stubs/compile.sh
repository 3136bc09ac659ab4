#!/bin/sh
# Compile the modules Terraport and TerraportSample against the stubs, as two engine versions: names and types alone.
# `--each`: every file alone, which finds what one forgets to include, and takes ten times as long.
set -e
cd "$(dirname "$0")/.."
files="Source/Terraport/Private/*.cpp Source/TerraportSample/Private/*.cpp"
compile() { # FILE OPTION ...
	"${CXX:-g++}" -std=c++17 -fsyntax-only -fno-exceptions -fno-rtti -Wall -Wextra -Wshadow -Werror -DTERRAPORTCORE_API=DLLIMPORT -DSTUB_ENGINE_MINOR="$minor" \
		-I. -Istubs -Istubs/generated -ISource/Terraport/Public -ISource/Terraport/Private -ISource/TerraportCore/Public \
		-ISource/TerraportSample/Public -x c++ "$@"
}
for minor in 1 4; do
	if [ "$1" = --each ]; then
		for file in $files; do compile "$file"; done
	else
		# GCC takes an included .cpp for a header, whose classes had better not hold what is anonymous.
		printf '#include "%s"\n' $files | compile - -Wno-subobject-linkage
	fi
done
