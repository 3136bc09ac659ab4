#!/bin/sh
# Compile the modules Terraport and TerraportSample against the stubs, as two engine versions: names and types alone.
set -e
cd "$(dirname "$0")/.."
for minor in 1 4; do
	for file in Source/Terraport/Private/*.cpp Source/TerraportSample/Private/*.cpp; do
		"${CXX:-g++}" -std=c++17 -fsyntax-only -fno-exceptions -fno-rtti -Wall -Wextra -Wshadow -Werror -DTERRAPORTCORE_API=DLLIMPORT -DSTUB_ENGINE_MINOR=$minor \
			-Istubs -Istubs/generated -ISource/Terraport/Public -ISource/Terraport/Private -ISource/TerraportCore/Public \
			-ISource/TerraportSample/Public "$file"
	done
done
