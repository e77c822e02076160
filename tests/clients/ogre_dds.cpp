// What OGRE makes of a DDS file: its size and form on standard output, its texels to a file.
//
//     ogre_dds FILE.dds TEXELS
#include <OgreDDSCodec.h>
#include <OgreDataStream.h>
#include <OgreImage.h>
#include <OgreLogManager.h>

#include <fstream>
#include <iostream>

int main(int count, char** arguments) {
    if (count != 3)
        return 1;
    Ogre::LogManager log;
    log.createLog("", true, false, true); // to nowhere
    Ogre::DDSCodec::startup();
    const Ogre::DataStreamPtr stream(
        new Ogre::FileStreamDataStream(new std::ifstream(arguments[1], std::ios::binary)));
    Ogre::Image image;
    image.load(stream, "dds");
    std::ofstream(arguments[2], std::ios::binary)
        .write(reinterpret_cast<const char*>(image.getData()), std::streamsize(image.getSize()));
    std::cout << image.getWidth() << ' ' << image.getHeight() << ' ' << image.getDepth() << ' '
              << Ogre::PixelUtil::getFormatName(image.getFormat()) << '\n';
}
