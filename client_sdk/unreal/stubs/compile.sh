#!/bin/sh
# Compile the modules against the stubs as Unreal 5.4 and 5.8 (C++20), and the core as C++17 too. Names and types alone.
# `--each`: every file alone, which finds what one forgets to include, and takes ten times as long.
set -e
cd "$(dirname "$0")/.."
files="Source/Terraport/Private/*.cpp Source/Terraport/Private/Extras/*.cpp Source/TerraportSample/Private/*.cpp"
compile() { # STANDARD FILE OPTION ...
	standard="$1"
	shift
	"${CXX:-g++}" -std="c++$standard" -fsyntax-only -fno-exceptions -fno-rtti -Wall -Wextra -Wshadow -Werror -I. \
		-ISource/Terraport/Private -x c++ "$@"
}
merged() { # FILE ...: GCC takes an included .cpp for a header, whose classes had better not hold what is anonymous.
	printf '#include "%s"\n' "$@"
}
for minor in 4 8; do
	options="-DSTUB_ENGINE_MINOR=$minor -Istubs -Istubs/generated -ISource/Terraport/Public -ISource/TerraportSample/Public"
	if [ "$1" = --each ]; then
		for file in $files; do compile 20 "$file" $options; done
	else
		merged $files | compile 20 - -Wno-subobject-linkage $options
	fi
	echo "5.$minor: both modules"
done
for file in Source/Terraport/Private/Core/*.cpp Source/Terraport/Private/Core/Extras/*.cpp; do compile 17 "$file" -Wpedantic; done
echo "core: C++17"
